// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/preview_page.h"

#include <nlohmann/json.hpp>

#include "embedded/pipeline/preview/preview_page.js.h"
#include "formats/base/html_page.h"
#include "formats/base/json_text.h"
#include "pipeline/preview/preview_text.h"
#include "pipeline/preview/sheet_png.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

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
    const Tile& t = sheet.tiles[k];
    out["slices"].push_back({{"index", s.index},
                             {"z_mm", s.plane.z_mm},
                             {"spacing_mm", {s.plane.spacing_u_mm, s.plane.spacing_v_mm}},
                             {"area_mm2", s.area_mm2},
                             {"outlines", s.contours.rings.size()},
                             {"tile_px", {t.x, t.y, t.width, t.height}},
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

}  // namespace

std::string preview_page(const Preview& preview, const Sheet& sheet, const SheetText& text,
                         const std::string& kind, std::span<const std::uint8_t> png) {
  json page = {
      {"title", text.title},
      {"size", size_text(preview, sheet.view)},
      {"options", text.options},
      {"picture",
       {{"width", sheet.picture.width}, {"height", sheet.picture.height}, {"src", png_url(png)}}}};
  if (const auto* wanted = std::get_if<Labels>(&preview.segmentation)) {
    page["material"] = json::array();
    for (const auto& [label, voxels] : preview.label_voxels) {
      if (wanted->all || wanted->labels.contains(label)) page["material"].push_back(label);
    }
  } else {
    page["control"] =
        std::holds_alternative<Equalize>(preview.segmentation) ? "level" : "threshold";
    page["changes"] = changes_text(preview);
  }
  return html_page(
      "trocar-mesh preview", kPreviewPage,
      {{"preview", json_text(numbers_of(preview, sheet, kind))}, {"page", json_text(page)}});
}

}  // namespace trocar::pipeline
