// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review.h"

#include <sodium.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "formats/base/file_io.h"
#include "formats/base/html_text.h"
#include "pipeline/farm/store.h"
#include "pipeline/farm/stored_asset.h"
#include "pipeline/for_each_piece.h"
#include "pipeline/mesh_thumbnail.h"
#include "pipeline/preview_file.h"
#include "pipeline/store_diff.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using farm::IndexedScan;
using farm::Store;
using nlohmann::json;
using Kind = ScanDifference::Kind;

constexpr int kThumbnail_px = 168;
constexpr std::size_t kMostRows = 500;  // of the table of differences
constexpr const char* kMark = "<meta name=\"generator\" content=\"trocar-mesh review\">";
constexpr const char* kStyle =
    "body{font:14px/1.4 'DejaVu Sans',Verdana,sans-serif;background:#141619;color:#e4e6e9;"
    "margin:1.2em 1.6em}a{color:#56b4e9}"
    ".cards{display:flex;flex-wrap:wrap;gap:10px}"
    ".card{width:168px;content-visibility:auto;contain-intrinsic-size:168px 250px}"
    ".card img{display:block}.card p{margin:.2em 0;font-size:12px;overflow-wrap:anywhere}"
    ".two{width:346px}.two div{display:flex;gap:10px}"
    ".none{width:168px;height:168px;background:#23262b}.bad{color:#ffcd5a}"
    "table{border-collapse:collapse;margin:1em 0}caption{text-align:left;font-weight:bold}"
    "td,th{text-align:right;padding:.1em .8em;border-bottom:1px solid #464a50}"
    "td:first-child,th:first-child{text-align:left}";

std::string base64(std::span<const std::uint8_t> bytes) {
  std::string out(sodium_base64_ENCODED_LEN(bytes.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(out.data(), out.size(), bytes.data(), bytes.size(),
                    sodium_base64_VARIANT_ORIGINAL);
  out.pop_back();  // the final zero
  return out;
}

Result<Store> open_store(const fs::path& folder) {
  std::error_code ignored;
  if (!fs::exists(folder / "trocar-store.json", ignored))
    return refused(folder.string() + ": is no store of trocar-mesh batch");
  return Store::open_for_reading(folder);
}

std::string signed_text(double value) {
  return std::string(value > 0 ? "+" : "").append(number_text(value));
}

double change(const Both<std::uint64_t>& of) {
  return static_cast<double>(of.now) - static_cast<double>(of.before);
}

json difference_json(const ScanDifference& d) {
  json out = {{"scan", d.name},
              {"kind", name_of(d.kind)},
              {"bytes", d.bytes.now},
              {"bytes_before", d.bytes.before}};
  if (!d.reason.empty()) out["reason"] = d.reason;
  if (d.kind != Kind::kChanged) return out;
  const AssetDifference& g = d.geometry;
  out["hausdorff_mm"] = g.hausdorff_mm;
  out["worst_slice"] = g.worst_slice < 0 ? json() : json(g.worst_slice);
  out["slices_changed"] = g.slices_changed;
  out["slices_only_now"] = g.slices_alone.now;
  out["slices_only_before"] = g.slices_alone.before;
  out["area_mm2"] = g.area_mm2.now;
  out["area_mm2_before"] = g.area_mm2.before;
  out["triangles"] = g.triangles.now;
  out["triangles_before"] = g.triangles.before;
  return out;
}

// What is shown of a scan.
struct Card {
  std::string name;
  std::optional<farm::Object> now, before;
  std::string reason;  // there is no picture, or one of an earlier asset only
  const ScanDifference* difference = nullptr;
};

std::string picture(const Store& store, const farm::Object& object, std::string& caption,
                    bool& is_damaged) {
  const auto asset = farm::read_stored_asset(store, object);
  if (!asset) {
    is_damaged = true;
    caption = "<p class=\"bad\">" + html_text(asset.error().message) + "</p>";
    return "<div class=\"none\"></div>";
  }
  const auto slice = middle_slice(*asset);
  if (!slice) {
    caption = "<p>no triangles</p>";
    return "<div class=\"none\"></div>";
  }
  const Thumbnail thumbnail = draw_thumbnail(*asset, *slice, kThumbnail_px);
  std::size_t triangles = 0;
  for (const AssetSlice& s : asset->slices)
    triangles += s.mesh.triangles.size();
  caption = "<p>slice " + std::to_string(*slice) + " of " + std::to_string(slice_count(*asset)) +
            ", " + number_text(thumbnail.width_mm, 3) + " x " +
            number_text(thumbnail.height_mm, 3) + " mm<br>" + std::to_string(triangles) +
            " triangles, " + number_text(static_cast<double>(object.bytes) / 1e3, 3) + " kB</p>";
  const auto png = png_of(thumbnail.picture);
  if (!png) return "<div class=\"none\"></div>";
  const std::string size = std::to_string(kThumbnail_px);
  return "<img loading=\"lazy\" decoding=\"async\" alt=\"middle slice\" width=\"" + size +
         "\" height=\"" + size + "\" src=\"data:image/png;base64," + base64(*png) + "\">";
}

std::string difference_text(const ScanDifference& d) {
  if (d.kind != Kind::kChanged) return name_of(d.kind);
  const AssetDifference& g = d.geometry;
  std::string out = number_text(g.hausdorff_mm, 3) + " mm";
  if (g.worst_slice >= 0) out += " in slice " + std::to_string(g.worst_slice);
  out += ", area " + signed_text(g.area_mm2.now - g.area_mm2.before) + " mm\u00b2, " +
         signed_text(change(g.triangles)) + " triangles, " + signed_text(change(d.bytes)) +
         " bytes";
  if (g.slices_alone.now > 0) out += ", " + std::to_string(g.slices_alone.now) + " slices only now";
  if (g.slices_alone.before > 0)
    out += ", " + std::to_string(g.slices_alone.before) + " slices only before";
  return out;
}

std::string card_html(const Store& now, const Store* before, const Card& card, bool& is_damaged) {
  const bool two = card.now && card.before;
  std::string out = "<div class=\"card" + std::string(two ? " two" : "") + "\" id=\"" +
                    html_text(card.name) + "\"><div>";
  std::string caption, other;
  out += card.now ? picture(now, *card.now, caption, is_damaged) : "<div class=\"none\"></div>";
  bool ignored = false;
  if (two) out += picture(*before, *card.before, other, ignored);
  out += "</div><p><b>" + html_text(card.name) + "</b></p>" + caption;
  if (card.difference != nullptr)
    out += "<p class=\"bad\">" + html_text(difference_text(*card.difference)) + "</p>";
  if (!card.reason.empty()) out += "<p class=\"bad\">" + html_text(card.reason) + "</p>";
  return out + "</div>\n";
}

// Scans that differ, worst first, then those that are not done, then the others.
std::vector<Card> cards_of(const std::vector<IndexedScan>& scans,
                           const std::map<std::string, farm::Object>& before,
                           const std::vector<ScanDifference>& differences) {
  std::map<std::string, const IndexedScan*> by_name;
  for (const IndexedScan& scan : scans)
    by_name[scan.name] = &scan;
  std::vector<Card> out;
  const auto add = [&](const IndexedScan& scan, const ScanDifference* difference) {
    Card card{scan.name, {}, {}, scan.reason, difference};
    if (scan.status == IndexedScan::Status::kDone) card.now = scan.asset;
    const auto other = before.find(scan.name);
    if (difference != nullptr && other != before.end()) card.before = other->second;
    out.push_back(std::move(card));
  };
  for (const ScanDifference& d : differences) {
    const auto at = by_name.find(d.name);
    if (at == by_name.end()) continue;  // gone: in the table only
    add(*at->second, &d);
    by_name.erase(at);
  }
  for (const bool is_done : {false, true}) {
    for (const auto& [name, scan] : by_name) {
      if ((scan->status == IndexedScan::Status::kDone) == is_done) add(*scan, nullptr);
    }
  }
  return out;
}

fs::path page_file(const fs::path& first, std::size_t page) {
  if (page == 0) return first;
  return first.parent_path() /
         (first.stem().string() + "-" + std::to_string(page + 1) + first.extension().string());
}

bool is_review(const fs::path& file) {
  std::string head(512, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  return head.find(kMark) != std::string::npos;
}

std::string links(const fs::path& first, std::size_t page, std::size_t pages) {
  if (pages == 1) return "";
  std::string out = "<p>page ";
  for (std::size_t k = 0; k < pages; ++k) {
    const std::string number = std::to_string(k + 1);
    out += k == page ? "<b>" + number + "</b> "
                     : "<a href=\"" + html_text(page_file(first, k).filename().string()) + "\">" +
                           number + "</a> ";
  }
  return out + "</p>\n";
}

std::string table(const StoreDiff& diff, const fs::path& first) {
  if (diff.differences.empty()) return "<p>All assets are the same.</p>\n";
  std::string out =
      "<table><caption>Differences, worst first</caption>\n<tr><th>scan<th>what<th>distance mm<th>"
      "slice<th>area mm\u00b2<th>triangles<th>bytes</tr>\n";
  std::size_t shown = 0;
  for (const ScanDifference& d : diff.differences) {
    if (shown == kMostRows) break;
    const AssetDifference& g = d.geometry;
    const std::string page = html_text(page_file(first, shown / kScansPerPage).filename().string());
    out += "<tr><td>" + (d.kind == Kind::kGone ? html_text(d.name)
                                               : "<a href=\"" + page + "#" + html_text(d.name) +
                                                     "\">" + html_text(d.name) + "</a>");
    out += std::string("<td>") + name_of(d.kind);
    if (d.kind == Kind::kChanged) {
      out += "<td>" + number_text(g.hausdorff_mm, 3) + "<td>" +
             (g.worst_slice < 0 ? std::string() : std::to_string(g.worst_slice)) + "<td>" +
             signed_text(g.area_mm2.now - g.area_mm2.before) + "<td>" +
             signed_text(change(g.triangles)) + "<td>" + signed_text(change(d.bytes));
    } else {
      out += "<td><td><td><td><td>" + signed_text(change(d.bytes));
    }
    out += "</tr>\n";
    if (d.kind != Kind::kGone) ++shown;
  }
  out += "</table>\n";
  if (diff.differences.size() > kMostRows)
    out += "<p>and " + std::to_string(diff.differences.size() - kMostRows) +
           " more; all: --json</p>\n";
  return out;
}

struct Counts {
  std::size_t done = 0, failed = 0, damaged = 0;
  std::uint64_t bytes = 0;
};

Counts count(const std::vector<IndexedScan>& scans) {
  Counts out;
  for (const IndexedScan& scan : scans) {
    out.done += scan.status == IndexedScan::Status::kDone ? 1 : 0;
    out.failed += scan.status == IndexedScan::Status::kFailed ? 1 : 0;
    out.damaged += scan.status == IndexedScan::Status::kDamaged ? 1 : 0;
    out.bytes += scan.asset.bytes;
  }
  return out;
}

std::string head(const Counts& counts) {
  return std::string("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">") + kMark +
         "<title>Review of a store</title><style>" + kStyle +
         "</style></head><body>\n<h1>Review of a store</h1>\n<p>" + std::to_string(counts.done) +
         " assets of " + number_text(static_cast<double>(counts.bytes) / 1e6) + " MB, " +
         std::to_string(counts.failed) + " failed scans, " + std::to_string(counts.damaged) +
         " damaged entries. Pictures: the middle slice with its mesh and outline, grey by "
         "HU.</p>\n";
}

}  // namespace

Result<json> write_review(const ReviewOptions& options) {
  const auto store = open_store(options.store);
  if (!store) return store.error();
  const std::vector<IndexedScan> scans = farm::indexed_scans(*store);
  if (scans.empty()) return refused(options.store.string() + ": the store has no scans");

  std::optional<Store> other;
  StoreDiff diff;
  std::map<std::string, farm::Object> before;
  if (!options.against.empty()) {
    auto opened = open_store(options.against);
    if (!opened) return opened.error();
    other = std::move(*opened);
    auto compared = compare_stores(*store, *other, options.stop);
    if (!compared) return compared.error();
    diff = std::move(*compared);
    for (IndexedScan& scan : farm::indexed_scans(*other)) {
      if (scan.status == IndexedScan::Status::kDone) before[scan.name] = scan.asset;
    }
  }

  Counts counts = count(scans);
  const std::vector<Card> cards = cards_of(scans, before, diff.differences);
  const std::size_t pages = (cards.size() + kScansPerPage - 1) / kScansPerPage;
  json files = json::array();
  for (std::size_t page = 0; page < pages; ++page) {
    const std::size_t first = page * kScansPerPage,
                      size = std::min(kScansPerPage, cards.size() - first);
    std::vector<std::string> made(size);
    std::vector<char> damaged(size, 0);
    for_each_piece(static_cast<int>(size), [&](int i) {
      if (options.stop != nullptr && *options.stop) return;
      const auto k = static_cast<std::size_t>(i);
      bool is_damaged = false;
      made[k] = card_html(*store, other ? &*other : nullptr, cards[first + k], is_damaged);
      damaged[k] = is_damaged ? 1 : 0;
    });
    if (options.stop != nullptr && *options.stop) return unwritable("interrupted");
    std::string text = head(counts) + links(options.page, page, pages);
    if (page == 0 && other) text += table(diff, options.page);
    text += "<div class=\"cards\">\n";
    for (std::size_t k = 0; k < size; ++k)
      text += made[k];
    text += "</div>\n" + links(options.page, page, pages) + "</body></html>\n";
    counts.damaged += static_cast<std::size_t>(std::count(damaged.begin(), damaged.end(), 1));
    if (auto ok = write_file_atomically(page_file(options.page, page), text); !ok)
      return ok.error();
    files.push_back(page_file(options.page, page).filename().string());
    if (options.progress) options.progress(first + size, cards.size());
  }
  std::error_code ignored;
  for (std::size_t page = pages; is_review(page_file(options.page, page)); ++page)
    fs::remove(page_file(options.page, page), ignored);

  json out = {{"schema", "trocar.review/1"}, {"scans", scans.size()},     {"done", counts.done},
              {"failed", counts.failed},     {"damaged", counts.damaged}, {"bytes", counts.bytes},
              {"pages", std::move(files)}};
  if (other) {
    out["same"] = diff.same;
    out["differences"] = json::array();
    for (const ScanDifference& d : diff.differences)
      out["differences"].push_back(difference_json(d));
  }
  return out;
}

}  // namespace trocar::pipeline
