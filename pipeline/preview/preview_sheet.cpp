// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/preview_sheet.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

#include "pipeline/base/parallel_for.h"
#include "pipeline/preview/preview_text.h"
#include "pipeline/preview/sheet_drawing.h"
#include "pipeline/preview/sheet_panels.h"

namespace trocar::pipeline {
namespace {

constexpr int kGap = 14;
constexpr int kTileArea = 1160;  // height of all tiles of up to 16 slices
constexpr int kCaption = 42, kMinCell = 214;

Crop view_of(const Preview& preview) {
  constexpr double kMarginPart = 0.08, kMinMargin_mm = 4;
  const PreviewSlice& first = preview.shown[0];
  const double su = first.plane.spacing_u_mm, sv = first.plane.spacing_v_mm;
  Eigen::AlignedBox2d box;  // pixels
  for (const PreviewSlice& slice : preview.shown) {
    for (const Ring& ring : slice.contours.rings) {
      for (const LatticePoint& p : ring)
        box.extend(Eigen::Vector2d(preview.lattice.to_mm(p.x) / slice.plane.spacing_u_mm,
                                   preview.lattice.to_mm(p.y) / slice.plane.spacing_v_mm));
    }
  }
  const Crop& all = preview.crop;
  if (box.isEmpty()) return all;
  const double size_mm = box.sizes().cwiseProduct(Eigen::Vector2d(su, sv)).maxCoeff();
  const double margin_mm = std::max(kMarginPart * size_mm, kMinMargin_mm);
  const auto within = [](double value, int low, int high) {
    return static_cast<int>(
        std::lround(std::clamp(value, static_cast<double>(low), static_cast<double>(high))));
  };
  Crop out;
  out.x0 = within(std::floor(box.min().x() - margin_mm / su), all.x0, all.x1 - 1);
  out.x1 = within(std::ceil(box.max().x() + margin_mm / su), out.x0 + 1, all.x1);
  out.y0 = within(std::floor(box.min().y() - margin_mm / sv), all.y0, all.y1 - 1);
  out.y1 = within(std::ceil(box.max().y() + margin_mm / sv), out.y0 + 1, all.y1);
  return out;
}

// The layout in which the tiles have the largest scale that fits.
struct Grid {
  int columns = 1, rows = 1, tile_width = 1, tile_height = 1, cell_width = 1;
};

Grid grid_of(int slices, double width_mm, double height_mm) {
  const int inner = kWidth - 2 * kMargin;
  const int area = kTileArea * ((slices + 15) / 16);
  Grid best;
  double best_scale = 0;
  for (int columns = 1; columns <= slices; ++columns) {
    const int rows = (slices + columns - 1) / columns;
    const int cell = (inner - (columns - 1) * kGap) / columns;
    const int high = area / rows - kCaption - kGap;
    if ((cell < kMinCell || high < 40) && columns > 1) continue;
    const double scale = std::min(cell / width_mm, std::max(high, 40) / height_mm);
    if (scale <= best_scale) continue;
    best_scale = scale;
    const auto pixels = [scale](double mm) {
      return std::max(8, static_cast<int>(std::floor(mm * scale)));
    };
    best = {columns, rows, pixels(width_mm), pixels(height_mm), 1};
  }
  // Tiles are placed close to each other, not spread over the full width.
  const int cell = (inner - (best.columns - 1) * kGap) / best.columns;
  best.cell_width = std::min(cell, std::max(best.tile_width, kMinCell) + kGap);
  return best;
}

std::pair<double, double> window_of(const Preview& preview) {
  if (preview.unit == PixelUnit::kGrey) return {0, 255};
  if (preview.unit == PixelUnit::kHounsfield) {
    constexpr double kCentre = 400, kWide = 1800, kMin = 150;
    const auto* threshold = std::get_if<Threshold>(&preview.segmentation);
    double centre = kCentre;
    if (threshold != nullptr && (threshold->value < kCentre - kWide / 2 + kMin ||
                                 threshold->value > kCentre + kWide / 2 - kMin))
      centre = threshold->value;
    return {centre - kWide / 2, centre + kWide / 2};
  }
  // Other values are shown without the darkest and the brightest half per cent of the pixels.
  const Histogram& h = preview.histogram;
  std::int64_t all = 0, sum = 0;
  for (const std::int64_t count : h.counts)
    all += count;
  double low = preview.high, high = preview.low;
  for (std::size_t k = 0; k < h.counts.size(); ++k) {
    const double from = h.low + h.width * static_cast<double>(k);
    sum += h.counts[k];
    if (sum * 200 >= all) low = std::min(low, from);
    if (sum * 200 <= all * 199) high = from + 2 * h.width;
  }
  if (const auto* threshold = std::get_if<Threshold>(&preview.segmentation)) {
    low = std::min(low, threshold->value);
    high = std::max(high, threshold->value);
  }
  return {low, std::max(high, low + 1e-6)};
}

// The region of a slice that is shown, as RGB pixels.
cv::Mat shown_pixels(const Preview& preview, const PreviewSlice& slice, const Crop& view,
                     std::pair<double, double> window) {
  const double scale = 255 / (window.second - window.first);
  cv::Mat out(view.y1 - view.y0 + 1, view.x1 - view.x0 + 1, CV_8UC3);
  const auto paint = [&](const auto& image, const auto& colour_of) {
    for (int y = 0; y < out.rows; ++y)
      for (int x = 0; x < out.cols; ++x)
        out.at<cv::Vec3b>(y, x) =
            colour_of(image.at(x + view.x0 - preview.crop.x0, y + view.y0 - preview.crop.y0));
  };
  if (const auto* labels = std::get_if<LabelImage>(&slice.pixels)) {
    int last = 0;
    cv::Vec3b colour(0, 0, 0);
    paint(*labels, [&](int label) {
      if (label == last) return colour;
      const auto c = label != 0 ? label_colour(preview, label) : std::array<std::uint8_t, 3>{};
      last = label;
      return colour = {c[0], c[1], c[2]};
    });
  } else {
    paint(std::get<Image>(slice.pixels), [&](float value) {
      const auto level = cv::saturate_cast<std::uint8_t>((double{value} - window.first) * scale);
      return cv::Vec3b(level, level, level);
    });
  }
  return out;
}

void draw_contours(cv::Mat& tile, const Preview& preview, const PreviewSlice& slice,
                   const Crop& view) {
  constexpr int kShift = 6;
  const bool as_labels = std::holds_alternative<Labels>(preview.segmentation);
  const double sx = static_cast<double>(tile.cols) / (view.x1 - view.x0 + 1);
  const double sy = static_cast<double>(tile.rows) / (view.y1 - view.y0 + 1);
  // At the scan's edge the outline would lie half a pixel outside the tile and would not be drawn.
  const auto fixed = [](double at, int size) {
    return static_cast<int>(std::lround(std::clamp(at, 0.0, size - 1.0) * (1 << kShift)));
  };
  std::vector<std::vector<cv::Point>> lines;
  for (const Ring& ring : slice.contours.rings) {
    auto& line = lines.emplace_back();
    for (const LatticePoint& p : ring) {
      // Pixel (x0, y0) has its centre at half a pixel of the slice; OpenCV's pixels have theirs at
      // whole numbers.
      const double x = preview.lattice.to_mm(p.x) / slice.plane.spacing_u_mm - view.x0 + 0.5;
      const double y = preview.lattice.to_mm(p.y) / slice.plane.spacing_v_mm - view.y0 + 0.5;
      line.emplace_back(fixed(x * sx - 0.5, tile.cols), fixed(y * sy - 0.5, tile.rows));
    }
  }
  cv::polylines(tile, lines, true, as_labels ? cv::Scalar(255, 255, 255) : kOutlineColour, 1,
                cv::LINE_AA, kShift);
}

void draw_letters(cv::Mat& tile, const EdgeLetters& letters) {
  const int w = tile.cols, h = tile.rows;
  draw_label(tile, letters.left, 5, h / 2 + 5, kNormal, Align::kLeft);
  draw_label(tile, letters.right, w - 5, h / 2 + 5, kNormal, Align::kRight);
  draw_label(tile, letters.top, w / 2, 17, kNormal, Align::kCentre);
  draw_label(tile, letters.bottom, w / 2, h - 7, kNormal, Align::kCentre);
}

// Draws a scale bar in the lower left corner, at most a third as long as the tile is wide.
void draw_scale_bar(cv::Mat& tile, double px_per_mm) {
  const double length_mm = nice_below(tile.cols / 3.2 / px_per_mm);
  const int length = static_cast<int>(std::lround(length_mm * px_per_mm));
  const int x = 8, y = tile.rows - 9;
  for (const bool border : {true, false}) {
    const cv::Scalar colour = border ? cv::Scalar(0, 0, 0) : kLabel;
    const int width = border ? 4 : 2;
    cv::line(tile, {x, y}, {x + length, y}, colour, width);
    for (const int end : {x, x + length})
      cv::line(tile, {end, y - 4}, {end, y + 4}, colour, width);
  }
  draw_label(tile, number_text(length_mm) + " mm", x, y - 9, 0.42, Align::kLeft);
}

void draw_caption(cv::Mat& sheet, const Preview& preview, const PreviewSlice& slice,
                  const Tile& tile) {
  const bool has_z = preview.slices > 1;
  char z[48] = "";
  if (has_z) std::snprintf(z, sizeof z, "%.2f mm", slice.plane.z_mm);
  const int y = tile.y + tile.height + 16;
  draw_text(sheet, "slice " + std::to_string(slice.index), tile.x, y, kSmall, kText);
  const std::size_t outlines = slice.contours.rings.size();
  if (outlines == 0) {
    draw_text(sheet, "no material", tile.x, y + 18, kSmall, kWarning);
  } else {
    draw_text(sheet,
              number_text(slice.area_mm2, 5) + " mm2, " + std::to_string(outlines) +
                  (outlines == 1 ? " outline" : " outlines"),
              tile.x, y + 18, kSmall, kFaint);
  }
  if (has_z)
    draw_text(sheet, std::string("z ") + z, tile.x + std::max(tile.width, kMinCell - 4), y, kSmall,
              kFaint, Align::kRight);
}

std::string window_text(const Preview& preview, std::pair<double, double> window) {
  if (std::holds_alternative<Labels>(preview.segmentation)) return "colours: wanted labels";
  const std::string unit = preview.unit == PixelUnit::kHounsfield ? " HU" : "";
  return "window: centre " + number_text((window.first + window.second) / 2) + ", width " +
         number_text(window.second - window.first) + unit;
}

}  // namespace

Sheet draw_sheet(const Preview& preview, const SheetText& text) {
  Sheet out;
  out.view = view_of(preview);
  const auto window = window_of(preview);
  std::tie(out.window_low, out.window_high) = window;
  const SlicePlane& plane = preview.shown[0].plane;
  const double width_mm = (out.view.x1 - out.view.x0 + 1) * plane.spacing_u_mm;
  const double height_mm = (out.view.y1 - out.view.y0 + 1) * plane.spacing_v_mm;
  const int slices = static_cast<int>(preview.shown.size());
  const Grid grid = grid_of(slices, width_mm, height_mm);

  const int inner = kWidth - 2 * kMargin;
  const std::vector<std::string> title = wrapped(text.title, kLarge, inner);
  std::vector<std::string> lines = wrapped(size_text(preview, out.view), kNormal, inner);
  for (const std::string& line :
       wrapped(text.options + "; " + window_text(preview, window), kNormal, inner))
    lines.push_back(line);
  std::vector<std::string> warnings;
  for (const Warning& w : shown_warnings(preview)) {
    for (const std::string& line :
         wrapped("Warning (" + w.code + "): " + w.sentence, kSmall, inner))
      warnings.push_back(line);
  }
  constexpr std::size_t kMaxWarningLines = 12;
  if (warnings.size() > kMaxWarningLines) {
    warnings.resize(kMaxWarningLines - 1);
    warnings.emplace_back("... more warnings on the terminal");
  }
  const int head =
      kMargin + 30 * static_cast<int>(title.size()) + 24 * static_cast<int>(lines.size()) + 12;
  const int panel = head + grid.rows * (grid.tile_height + kCaption + kGap) + 4;
  const int foot = panel + panel_height(preview) + 20 * static_cast<int>(warnings.size()) +
                   (warnings.empty() ? 0 : kMargin);
  cv::Mat sheet(foot, kWidth, CV_8UC3, kBackground);

  const int below = draw_lines(sheet, title, kMargin, kMargin + 14, kLarge, kText, 30);
  draw_lines(sheet, lines, kMargin, below, kNormal, kFaint, 24);
  const int used = grid.columns * grid.cell_width + (grid.columns - 1) * kGap;
  const int left = kMargin + (inner - used) / 2;
  for (int i = 0; i < slices; ++i) {
    out.tiles.push_back({left + i % grid.columns * (grid.cell_width + kGap),
                         head + i / grid.columns * (grid.tile_height + kCaption + kGap),
                         grid.tile_width, grid.tile_height});
  }
  // Each thread draws into a different region of the picture.
  parallel_for(slices, [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    const PreviewSlice& slice = preview.shown[k];
    const Tile& at = out.tiles[k];
    cv::Mat tile = sheet(cv::Rect(at.x, at.y, at.width, at.height));
    const cv::Mat pixels = shown_pixels(preview, slice, out.view, window);
    const bool as_labels = std::holds_alternative<Labels>(preview.segmentation);
    const bool smaller = tile.cols < pixels.cols && tile.rows < pixels.rows;
    cv::resize(pixels, tile, tile.size(), 0, 0,
               as_labels ? cv::INTER_NEAREST_EXACT
               : smaller ? cv::INTER_AREA
                         : cv::INTER_LINEAR);
    draw_contours(tile, preview, slice, out.view);
    draw_scale_bar(tile, at.width / width_mm);
    draw_letters(tile, slice.letters);
  });
  for (std::size_t k = 0; k < out.tiles.size(); ++k)
    draw_caption(sheet, preview, preview.shown[k], out.tiles[k]);

  draw_panel(sheet, preview, panel);
  draw_lines(sheet, warnings, kMargin, panel + panel_height(preview) + 8, kSmall, kWarning, 20);
  out.picture = {sheet.cols, sheet.rows, std::vector<std::uint8_t>(sheet.datastart, sheet.dataend)};
  return out;
}

}  // namespace trocar::pipeline
