// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview_file.h"

#include <sodium.h>
#include <spng.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>

#include "formats/base/file_io.h"
#include "formats/base/html_text.h"
#include "formats/base/json_text.h"
#include "pipeline/number_ranges.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

constexpr const char* kSoftware = "trocar-mesh preview";

std::string base64(std::span<const std::uint8_t> bytes) {
  std::string out(sodium_base64_ENCODED_LEN(bytes.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(out.data(), out.size(), bytes.data(), bytes.size(),
                    sodium_base64_VARIANT_ORIGINAL);
  out.pop_back();  // the final zero
  return out;
}

std::string solid_text(const SolidOptions& o) {
  std::string out;
  if (o.min_volume_mm3 > 0)
    out += "; pieces below " + number_text(o.min_volume_mm3) + " mm3 dropped";
  if (o.fill_mm2) {
    out += "; filled inside";
    if (std::isfinite(*o.fill_mm2)) out += " up to " + number_text(*o.fill_mm2) + " mm2";
    if (o.close_mm > 0) out += ", gaps up to " + number_text(2 * o.close_mm) + " mm closed";
  }
  if (!o.mask_labels.empty()) out += "; within mask " + named_ranges("label", o.mask_labels);
  if (!o.seeds_lps_mm.empty()) {
    out += "; nearest to the first of " + std::to_string(o.seeds_lps_mm.size()) +
           (o.seeds_lps_mm.size() == 1 ? " seed" : " seeds");
  }
  if (o.largest > 0) out += "; largest " + std::to_string(o.largest);
  return out;
}

json edges(const Tile& t) {
  return {t.x, t.y, t.width, t.height};
}

json numbers_of(const Preview& preview, const Sheet& sheet, const std::string& kind) {
  const Crop& v = sheet.view;
  json out = {{"schema", "trocar.preview/1"},
              {"program", "trocar-mesh " TROCAR_VERSION},
              {"input", kind},
              {"unit", unit_name(preview)},
              {"slices_of_scan", preview.slices},
              {"pixels_shown", {v.x0, v.x1, v.y0, v.y1}},
              {"slices", json::array()},
              {"warnings", json::array()}};
  for (std::size_t k = 0; k < preview.shown.size(); ++k) {
    const PreviewSlice& s = preview.shown[k];
    out["slices"].push_back({{"index", s.index},
                             {"z_mm", s.plane.z_mm},
                             {"spacing_mm", {s.plane.spacing_u_mm, s.plane.spacing_v_mm}},
                             {"area_mm2", s.area_mm2},
                             {"outlines", s.contours.rings.size()},
                             {"tile_px", edges(sheet.tiles[k])},
                             {"letters",
                              {{"left", s.letters.left},
                               {"right", s.letters.right},
                               {"top", s.letters.top},
                               {"bottom", s.letters.bottom}}}});
  }
  for (const Warning& w : shown_warnings(preview))
    out["warnings"].push_back({{"code", w.code}, {"sentence", w.sentence}});
  if (std::holds_alternative<Labels>(preview.segmentation)) {
    out["label_voxels"] = json::array();
    for (const auto& [label, voxels] : preview.label_voxels)
      out["label_voxels"].push_back({{"label", label}, {"voxels", voxels}});
    return out;
  }
  out["window"] = {sheet.window_low, sheet.window_high};
  out["histogram"] = {{"low", preview.histogram.low},
                      {"bin_width", preview.histogram.width},
                      {"counts", preview.histogram.counts}};
  out["changes"] = json::array();
  for (const Change& c : preview.changes) {
    out["changes"].push_back({{"change", c.change},
                              {"threshold", c.threshold},
                              {"area_mm2", c.area_mm2},
                              {"outlines", c.outlines}});
  }
  return out;
}

using Rows = std::vector<std::vector<std::string>>;

std::string table(const std::string& caption, const Rows& rows) {
  std::string out = "<table><caption>" + html_text(caption) + "</caption>\n";
  for (std::size_t r = 0; r < rows.size(); ++r) {
    out += "<tr>";
    for (const std::string& cell : rows[r])
      out.append(r == 0 ? "<th>" : "<td>")
          .append(html_text(cell))
          .append(r == 0 ? "</th>" : "</td>");
    out += "</tr>\n";
  }
  return out + "</table>\n";
}

std::string tables(const Preview& preview) {
  Rows slices{{"slice", "z mm", "area mm\u00b2", "outlines"}};
  for (const PreviewSlice& s : preview.shown) {
    slices.push_back({std::to_string(s.index), number_text(s.plane.z_mm, 6),
                      number_text(s.area_mm2, 6), std::to_string(s.contours.rings.size())});
  }
  std::string out = table("Slices shown", slices);
  if (const auto* wanted = std::get_if<Labels>(&preview.segmentation)) {
    Rows labels{{"label", "voxels", "material"}};
    for (const auto& [label, voxels] : preview.label_voxels) {
      labels.push_back({std::to_string(label), std::to_string(voxels),
                        wanted->all || wanted->labels.contains(label) ? "yes" : "no"});
    }
    return table("Labels in the slices shown", labels) + out;
  }
  const std::string what =
      std::holds_alternative<Equalize>(preview.segmentation) ? "level" : "threshold";
  Rows changes{{"change", what, "area mm\u00b2", "outlines"}};
  for (const Change& c : preview.changes) {
    changes.push_back({number_text(c.change), number_text(c.threshold), number_text(c.area_mm2, 6),
                       std::to_string(c.outlines)});
  }
  return table("Another " + what, changes) + out + "<p>Another " + what + ": " +
         html_text(changes_text(preview)) + "</p>\n";
}

constexpr const char* kStyle =
    "body{font:15px/1.5 'DejaVu Sans',Verdana,sans-serif;background:#141619;color:#e4e6e9;"
    "max-width:1600px;margin:1.5em auto;padding:0 1em}img{max-width:100%;height:auto}"
    "table{border-collapse:collapse;display:inline-table;vertical-align:top;margin:1em 3em 1em 0}"
    "caption{text-align:left;font-weight:bold;padding:.3em 0}"
    "td,th{text-align:right;padding:.15em .9em;border-bottom:1px solid #464a50}"
    ".warning{color:#ffcd5a}";

}  // namespace

std::string input_kind(const SliceStack& stack) {
  if (stack.series) return "DICOM";
  return stack.pixel_unit() == PixelUnit::kGrey ? "images" : "NIfTI";
}

std::string sheet_title(const SliceStack& stack, const Preview& preview) {
  const std::string kind = input_kind(stack);
  return "Preview of " + (kind == "images" ? kind : "a " + kind + " scan") + ": " +
         std::to_string(preview.shown.size()) + " of " + std::to_string(preview.slices) +
         " slices" +
         (preview.unit == PixelUnit::kUncalibrated ? ", not a CT (values are not HU)" : "");
}

std::string options_text(const BatchOptions& options, const OpenOptions& input, PixelUnit unit) {
  std::string out = "material: ";
  const MeshOptions& mesh = options.mesh;
  if (const auto* threshold = std::get_if<Threshold>(&mesh.segmentation)) {
    out += "at or above " + number_text(threshold->value, 6);
    if (unit == PixelUnit::kHounsfield) out += " HU";
  } else if (const auto* equalize = std::get_if<Equalize>(&mesh.segmentation)) {
    out += "at or above level " + number_text(equalize->level, 6) + " after equalisation";
  } else {
    const auto& labels = std::get<Labels>(mesh.segmentation);
    out += labels.all ? "all labels" : named_ranges("label", labels.labels);
  }
  if (mesh.contour == ContourKind::kPixel) out += "; pixel chains";
  out += solid_text(options.solid);
  if (mesh.min_region_mm2 > 0)
    out += "; regions below " + number_text(mesh.min_region_mm2) + " mm2 dropped";
  if (options.slices) {
    out += "; slices " + std::to_string(options.slices->first) + " to " +
           std::to_string(options.slices->second);
  }
  if (mesh.crop) {
    out += "; crop " + std::to_string(mesh.crop->x0) + ":" + std::to_string(mesh.crop->x1) + "," +
           std::to_string(mesh.crop->y0) + ":" + std::to_string(mesh.crop->y1);
  }
  if (input.axis && *input.axis != SliceAxis::kTransverse)
    out += *input.axis == SliceAxis::kCoronal ? "; coronal slices" : "; sagittal slices";
  return out;
}

Result<std::vector<std::uint8_t>> png_of(const Picture& picture) {
  struct Free {
    void operator()(spng_ctx* c) const { spng_ctx_free(c); }
  };
  const std::unique_ptr<spng_ctx, Free> png(spng_ctx_new(SPNG_CTX_ENCODER));
  if (!png) return refused("not enough memory for the preview");
  const auto failed = [](int error) {
    return bug(std::string("the preview's PNG: ") + spng_strerror(error));
  };
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(picture.width);
  header.height = static_cast<std::uint32_t>(picture.height);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  spng_set_option(png.get(), SPNG_ENCODE_TO_BUFFER, 1);
  // Higher levels take several times as long for some per cent less.
  spng_set_option(png.get(), SPNG_IMG_COMPRESSION_LEVEL, 2);
  spng_set_option(png.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB);
  if (const int e = spng_set_ihdr(png.get(), &header); e != 0) return failed(e);
  std::string software = kSoftware;
  spng_text text{};
  std::strcpy(text.keyword, "Software");  // NOLINT(clang-analyzer-security.insecureAPI.strcpy)
  text.type = SPNG_TEXT;
  text.length = software.size();
  text.text = software.data();
  if (const int e = spng_set_text(png.get(), &text, 1); e != 0) return failed(e);
  if (const int e = spng_encode_image(png.get(), picture.rgb.data(), picture.rgb.size(),
                                      SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE);
      e != 0)
    return failed(e);
  std::size_t size = 0;
  int error = 0;
  const std::unique_ptr<void, void (*)(void*)> bytes(spng_get_png_buffer(png.get(), &size, &error),
                                                     std::free);
  if (!bytes) return failed(error);
  const auto* first = static_cast<const std::uint8_t*>(bytes.get());
  return std::vector<std::uint8_t>(first, first + size);
}

bool is_sheet(const std::filesystem::path& file) {
  // The text stands before the pixels.
  std::string head(256, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  return head.find(std::string("tEXtSoftware") + '\0' + kSoftware) != std::string::npos;
}

std::string page_of(const Preview& preview, const Sheet& sheet, const SheetText& text,
                    const std::string& kind, std::span<const std::uint8_t> png) {
  std::string numbers = json_text(numbers_of(preview, sheet, kind));
  for (std::size_t at = 0; (at = numbers.find('<', at)) != std::string::npos;)
    numbers.replace(at, 1, "\\u003c");
  std::string out = "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" +
                    html_text(text.title) + "</title><style>" + kStyle +
                    "</style></head><body>\n<h1>" + html_text(text.title) + "</h1>\n<p>" +
                    html_text(size_text(preview, sheet.view)) + "<br>" + html_text(text.options) +
                    "</p>\n";
  for (const Warning& w : shown_warnings(preview)) {
    out += "<p class=\"warning\">Warning (" + html_text(w.code) + "): " + html_text(w.sentence) +
           "</p>\n";
  }
  out += "<p><img alt=\"Contact sheet of the slices with their outlines\" width=\"" +
         std::to_string(sheet.picture.width) + "\" height=\"" +
         std::to_string(sheet.picture.height) + "\" src=\"data:image/png;base64," + base64(png) +
         "\"></p>\n" + tables(preview) + "<script type=\"application/json\" id=\"preview\">" +
         numbers + "</script>\n</body></html>\n";
  return out;
}

}  // namespace trocar::pipeline
