// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/review/review.h"

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "embedded/pipeline/review/review_page.html.h"
#include "formats/base/file_io.h"
#include "formats/base/html_page.h"
#include "formats/base/json_text.h"
#include "pipeline/base/parallel_for.h"
#include "pipeline/farm/store.h"
#include "pipeline/preview/sheet_png.h"
#include "pipeline/review/mesh_thumbnail.h"
#include "pipeline/review/store_diff.h"
#include "pipeline/review/stored_asset.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;
using farm::IndexedScan;
using farm::Store;
using nlohmann::json;
using Kind = ScanDifference::Kind;

constexpr int kThumbnail_px = 168;
constexpr std::size_t kMaxRows = 500;  // largest number of rows in the table of differences
constexpr const char* kMark = "<meta name=\"generator\" content=\"trocar-mesh review\">";

Result<Store> open_store(const fs::path& folder) {
  std::error_code ignored;
  if (!fs::exists(folder / "trocar-store.json", ignored))
    return refused(folder.string() + ": is no store of trocar-mesh batch");
  return Store::open_for_reading(folder);
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

// The data of a scan that a page shows.
struct Card {
  std::string name;
  std::optional<farm::Object> now, before;
  std::string reason;  // reason why there is no picture of the asset
  const ScanDifference* difference = nullptr;
};

// Picture and figures of an asset. If the asset is damaged, there is only "error"; if it has no
// triangles, only "bytes".
json asset_json(const Store& store, const farm::Object& object) {
  const auto asset = farm::read_stored_asset(store, object);
  if (!asset) return {{"error", asset.error().message}};
  json out = {{"bytes", object.bytes}};
  const auto slice = middle_slice(*asset);
  if (!slice) return out;
  const Thumbnail thumbnail = draw_thumbnail(*asset, *slice, kThumbnail_px);
  std::size_t triangles = 0;
  for (const AssetSlice& s : asset->slices)
    triangles += s.mesh.triangles.size();
  out["slice"] = *slice;
  out["slices"] = slice_count(*asset);
  out["size_mm"] = {thumbnail.width_mm, thumbnail.height_mm};
  out["triangles"] = triangles;
  if (const auto png = png_of(thumbnail.picture)) out["src"] = png_url(*png);
  return out;
}

json card_json(const Store& now, const Store* before, const Card& card) {
  json out = {{"name", card.name}};
  if (card.now) out["asset"] = asset_json(now, *card.now);
  if (before != nullptr && card.now && card.before)
    out["before"] = asset_json(*before, *card.before);
  if (card.difference != nullptr) out["difference"] = difference_json(*card.difference);
  if (!card.reason.empty()) out["reason"] = card.reason;
  return out;
}

// The scans that differ, most serious first, then those that are not done, then the others.
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
    if (at == by_name.end()) continue;  // a scan that is gone is only in the table
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

// The first kMaxRows differences, each with the page on which its scan is shown.
json difference_rows(const StoreDiff& diff) {
  json rows = json::array();
  std::size_t cards = 0;
  for (const ScanDifference& d : diff.differences) {
    if (rows.size() == kMaxRows) break;
    rows.push_back(difference_json(d));
    if (d.kind != Kind::kGone) rows.back()["page"] = cards++ / kScansPerPage;
  }
  return {{"further", diff.differences.size() - rows.size()}, {"scans", std::move(rows)}};
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
  for (std::size_t page = 0; page < pages; ++page)
    files.push_back(page_file(options.page, page).filename().string());
  for (std::size_t page = 0; page < pages; ++page) {
    const std::size_t first = page * kScansPerPage,
                      size = std::min(kScansPerPage, cards.size() - first);
    std::vector<json> made(size);
    parallel_for(static_cast<int>(size), [&](int i) {
      if (options.stop != nullptr && *options.stop) return;
      const auto k = static_cast<std::size_t>(i);
      made[k] = card_json(*store, other ? &*other : nullptr, cards[first + k]);
    });
    if (options.stop != nullptr && *options.stop) return unwritable("interrupted");
    for (const json& card : made)
      counts.damaged += card.contains("asset") && card["asset"].contains("error") ? 1 : 0;
    json shown = {{"counts",
                   {{"done", counts.done},
                    {"failed", counts.failed},
                    {"damaged", counts.damaged},
                    {"bytes", counts.bytes}}},
                  {"pages", files},
                  {"page", page},
                  {"cards", std::move(made)}};
    if (page == 0 && other) shown["differences"] = difference_rows(diff);
    const std::string text = html_page(kReviewPage, {{"review", json_text(shown)}});
    if (auto ok = write_file_atomically(page_file(options.page, page), text); !ok)
      return ok.error();
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
