// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview_sheet.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

#include "pipeline/for_each_piece.h"

namespace trocar::pipeline {
namespace {

// All colours are RGB.
const cv::Scalar kBackground(20, 22, 25), kText(228, 230, 233), kFaint(150, 155, 162),
    kLine(70, 74, 80), kOutline(255, 165, 0), kThreshold(255, 165, 0), kBars(120, 140, 160),
    kWarning(255, 205, 90);
constexpr int kWidth = 1600, kMargin = 24, kGap = 14;
constexpr int kTileArea = 1160;  // height for up to 16 slices
constexpr int kCaption = 42, kLeastCell = 214;
constexpr int kPanel = 300;
constexpr double kSmall = 0.46, kNormal = 0.54, kLarge = 0.85;
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

std::string ascii(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0U) != 0x80U) out += byte >= 32 && byte < 127 ? c : '?';
  }
  return out;
}

int text_width(const std::string& text, double size) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, size, 1, &baseline).width;
}

enum class Align { kLeft, kCentre, kRight };

// (x, y): of the baseline's left end, middle or right end.
void draw_text(cv::Mat& on, const std::string& text, int x, int y, double size,
               const cv::Scalar& colour, Align align = Align::kLeft) {
  const std::string drawn = ascii(text);
  if (align != Align::kLeft) {
    const int width = text_width(drawn, size);
    x -= align == Align::kCentre ? width / 2 : width;
  }
  cv::putText(on, drawn, {x, y}, kFont, size, colour, size > 0.8 ? 2 : 1, cv::LINE_AA);
}

// With a dark border, on a picture.
void draw_label(cv::Mat& on, const std::string& text, int x, int y, double size, Align align) {
  const std::string drawn = ascii(text);
  const int width = text_width(drawn, size);
  if (align != Align::kLeft) x -= align == Align::kCentre ? width / 2 : width;
  cv::putText(on, drawn, {x, y}, kFont, size, cv::Scalar(0, 0, 0), 4, cv::LINE_AA);
  cv::putText(on, drawn, {x, y}, kFont, size, cv::Scalar(160, 225, 255), 1, cv::LINE_AA);
}

std::vector<std::string> wrapped(const std::string& given, double size, int width) {
  std::vector<std::string> out(1);
  const std::string text = ascii(given) + " ";
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = text.find(' ', at);
    std::string word = text.substr(at, end - at);
    at = end + 1;
    const std::string longer = out.back().empty() ? word : out.back() + " " + word;
    if (text_width(longer, size) <= width) {
      out.back() = longer;
      continue;
    }
    if (!out.back().empty()) out.emplace_back();
    for (; text_width(word, size) > width && word.size() > 1; out.emplace_back()) {
      std::size_t fits = word.size() - 1;
      while (fits > 1 && text_width(word.substr(0, fits), size) > width)
        --fits;
      out.back() = word.substr(0, fits);
      word.erase(0, fits);
    }
    out.back() = word;
  }
  return out;
}

// 1, 2 or 5 times a power of ten, at most `value`.
double nice_below(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {5.0, 2.0}) {
    if (value >= factor * power) return factor * power;
  }
  return power;
}

Crop view_of(const Preview& preview) {
  constexpr double kMarginPart = 0.08, kLeastMargin_mm = 4;
  const PreviewSlice& first = preview.shown[0];
  const double su = first.plane.spacing_u_mm, sv = first.plane.spacing_v_mm;
  double low_x = 1e30, high_x = -1e30, low_y = 1e30, high_y = -1e30;  // pixels
  for (const PreviewSlice& slice : preview.shown) {
    for (const Ring& ring : slice.contours.rings) {
      for (const LatticePoint& p : ring) {
        const double x = preview.lattice.to_mm(p.x) / slice.plane.spacing_u_mm;
        const double y = preview.lattice.to_mm(p.y) / slice.plane.spacing_v_mm;
        low_x = std::min(low_x, x), high_x = std::max(high_x, x);
        low_y = std::min(low_y, y), high_y = std::max(high_y, y);
      }
    }
  }
  const Crop& all = preview.crop;
  if (!(low_x <= high_x)) return all;
  const double size_mm = std::max((high_x - low_x) * su, (high_y - low_y) * sv);
  const double margin_mm = std::max(kMarginPart * size_mm, kLeastMargin_mm);
  const auto within = [](double value, int low, int high) {
    return static_cast<int>(
        std::lround(std::clamp(value, static_cast<double>(low), static_cast<double>(high))));
  };
  Crop out;
  out.x0 = within(std::floor(low_x - margin_mm / su), all.x0, all.x1 - 1);
  out.x1 = within(std::ceil(high_x + margin_mm / su), out.x0 + 1, all.x1);
  out.y0 = within(std::floor(low_y - margin_mm / sv), all.y0, all.y1 - 1);
  out.y1 = within(std::ceil(high_y + margin_mm / sv), out.y0 + 1, all.y1);
  return out;
}

// The size of tiles, and how many stand side by side: the largest scale that fits.
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
    if ((cell < kLeastCell || high < 40) && columns > 1) continue;
    const double scale = std::min(cell / width_mm, std::max(high, 40) / height_mm);
    if (scale <= best_scale) continue;
    best_scale = scale;
    const auto pixels = [scale](double mm) {
      return std::max(8, static_cast<int>(std::floor(mm * scale)));
    };
    best = {columns, rows, pixels(width_mm), pixels(height_mm), 1};
  }
  // Beside each other rather than spread over the whole width.
  const int cell = (inner - (best.columns - 1) * kGap) / best.columns;
  best.cell_width = std::min(cell, std::max(best.tile_width, kLeastCell) + kGap);
  return best;
}

std::pair<double, double> window_of(const Preview& preview) {
  if (preview.unit == PixelUnit::kGrey) return {0, 255};
  if (preview.unit == PixelUnit::kHounsfield) {
    constexpr double kCentre = 400, kWide = 1800, kLeast = 150;
    const auto* threshold = std::get_if<Threshold>(&preview.segmentation);
    double centre = kCentre;
    if (threshold != nullptr && (threshold->value < kCentre - kWide / 2 + kLeast ||
                                 threshold->value > kCentre + kWide / 2 - kLeast))
      centre = threshold->value;
    return {centre - kWide / 2, centre + kWide / 2};
  }
  // Without the darkest and the brightest half per cent.
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

// The part of a slice that is shown, as RGB pixels.
cv::Mat shown_pixels(const Preview& preview, const PreviewSlice& slice, const Crop& view,
                     std::pair<double, double> window) {
  const bool as_labels = std::holds_alternative<Labels>(preview.segmentation);
  const double scale = 255 / (window.second - window.first);
  cv::Mat out(view.y1 - view.y0 + 1, view.x1 - view.x0 + 1, CV_8UC3);
  float last = 0;
  cv::Vec3b colour(0, 0, 0);
  for (int y = 0; y < out.rows; ++y) {
    for (int x = 0; x < out.cols; ++x) {
      const float value =
          slice.image.at(x + view.x0 - preview.crop.x0, y + view.y0 - preview.crop.y0);
      if (!as_labels) {
        const auto level = cv::saturate_cast<std::uint8_t>((double{value} - window.first) * scale);
        out.at<cv::Vec3b>(y, x) = {level, level, level};
        continue;
      }
      if (value != last) {
        const bool is_label = std::rint(value) == value && std::abs(value) < 1e9F;
        const auto c = is_label && value != 0 ? label_colour(preview, static_cast<int>(value))
                                              : std::array<std::uint8_t, 3>{};
        colour = {c[0], c[1], c[2]};
        last = value;
      }
      out.at<cv::Vec3b>(y, x) = colour;
    }
  }
  return out;
}

void draw_contours(cv::Mat& tile, const Preview& preview, const PreviewSlice& slice,
                   const Crop& view) {
  constexpr int kShift = 6;
  const bool as_labels = std::holds_alternative<Labels>(preview.segmentation);
  const double sx = static_cast<double>(tile.cols) / (view.x1 - view.x0 + 1);
  const double sy = static_cast<double>(tile.rows) / (view.y1 - view.y0 + 1);
  // At the scan's edge the outline is half a pixel outside the tile, where it would not be drawn.
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
  cv::polylines(tile, lines, true, as_labels ? cv::Scalar(255, 255, 255) : kOutline, 1, cv::LINE_AA,
                kShift);
}

void draw_letters(cv::Mat& tile, const EdgeLetters& letters) {
  const int w = tile.cols, h = tile.rows;
  draw_label(tile, letters.left, 5, h / 2 + 5, kNormal, Align::kLeft);
  draw_label(tile, letters.right, w - 5, h / 2 + 5, kNormal, Align::kRight);
  draw_label(tile, letters.top, w / 2, 17, kNormal, Align::kCentre);
  draw_label(tile, letters.bottom, w / 2, h - 7, kNormal, Align::kCentre);
}

// In the lower left corner, at most a third as long as the tile is wide.
void draw_scale_bar(cv::Mat& tile, double px_per_mm) {
  const double length_mm = nice_below(tile.cols / 3.2 / px_per_mm);
  const int length = static_cast<int>(std::lround(length_mm * px_per_mm));
  const int x = 8, y = tile.rows - 9;
  for (const bool border : {true, false}) {
    const cv::Scalar colour = border ? cv::Scalar(0, 0, 0) : cv::Scalar(160, 225, 255);
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
    draw_text(sheet, std::string("z ") + z, tile.x + std::max(tile.width, kLeastCell - 4), y,
              kSmall, kFaint, Align::kRight);
}

struct Plot {
  int x = 0, y = 0, width = 0, height = 0;  // y: of its top
};

void draw_grid_lines(cv::Mat& sheet, const Plot& plot, double most_log) {
  for (int power = 0; power <= static_cast<int>(most_log); ++power) {
    const int y = plot.y + plot.height -
                  static_cast<int>(std::lround(plot.height * (power + 0.3) / (most_log + 0.3)));
    cv::line(sheet, {plot.x, y}, {plot.x + plot.width, y}, kLine, 1);
    static constexpr const char* kNames[] = {"1",     "10",  "100",  "1 k",   "10 k",
                                             "100 k", "1 M", "10 M", "100 M", "1 G"};
    const char* text = kNames[std::min<std::size_t>(static_cast<std::size_t>(power), 9)];
    draw_text(sheet, text, plot.x - 8, y + 5, 0.4, kFaint, Align::kRight);
  }
}

void draw_value_axis(cv::Mat& sheet, const Plot& plot, double low, double high) {
  const double step = nice_below((high - low) / 7 * 1.999);
  const int base = plot.y + plot.height;
  cv::line(sheet, {plot.x, base}, {plot.x + plot.width, base}, kFaint, 1);
  const double first = std::ceil(low / step) * step;
  constexpr int kMost = 20;
  for (int k = 0; k < kMost && first + k * step <= high; ++k) {
    const double tick = first + k * step;
    const int x = plot.x + static_cast<int>(std::lround((tick - low) / (high - low) * plot.width));
    cv::line(sheet, {x, base}, {x, base + 5}, kFaint, 1);
    draw_text(sheet, number_text(std::abs(tick) < step / 1e6 ? 0 : tick), x, base + 20, 0.42,
              kFaint, Align::kCentre);
  }
}

// The threshold, or with equalisation the values that the level has in the slices shown.
void draw_threshold(cv::Mat& sheet, const Preview& preview, const Plot& plot, double low,
                    double high) {
  const auto* threshold = std::get_if<Threshold>(&preview.segmentation);
  const double from = threshold != nullptr ? threshold->value : preview.lowest_cut;
  const double to = threshold != nullptr ? threshold->value : preview.highest_cut;
  if (!(from <= to)) return;
  const auto at = [&](double value) {
    return plot.x + static_cast<int>(std::lround(
                        std::clamp((value - low) / (high - low), 0.0, 1.0) * plot.width));
  };
  for (const double value : {from, to})
    cv::line(sheet, {at(value), plot.y - 6}, {at(value), plot.y + plot.height}, kThreshold, 1);
  const std::string unit = preview.unit == PixelUnit::kHounsfield ? " HU" : "";
  const std::string text =
      from == to ? number_text(from) + unit
                 : "this level: " + number_text(from) + " to " + number_text(to) + unit;
  const int half = text_width(text, kSmall) / 2;
  const int x = std::clamp((at(from) + at(to)) / 2, plot.x + half, plot.x + plot.width - half);
  draw_text(sheet, text, x, plot.y - 11, kSmall, kThreshold, Align::kCentre);
}

std::string slices_shown(const Preview& preview) {
  const std::size_t n = preview.shown.size();
  return n == 1 ? "the slice shown" : "the " + std::to_string(n) + " slices shown";
}

void draw_histogram(cv::Mat& sheet, const Preview& preview, int x, int y) {
  const Histogram& h = preview.histogram;
  draw_text(
      sheet,
      "Pixels of " + slices_shown(preview) + ", by value in " + unit_name(preview) + " (log scale)",
      x, y + 16, kNormal, kText);
  const Plot plot{x + 56, y + 56, 820, kPanel - 96};
  const double low = h.low, high = h.low + h.width * static_cast<double>(h.counts.size());
  const std::int64_t most = *std::max_element(h.counts.begin(), h.counts.end());
  const double most_log = std::max(1.0, std::log10(static_cast<double>(most)));
  draw_grid_lines(sheet, plot, most_log);
  const auto* threshold = std::get_if<Threshold>(&preview.segmentation);
  const double cut = threshold != nullptr ? threshold->value : preview.highest_cut;
  for (std::size_t k = 0; k < h.counts.size(); ++k) {
    if (h.counts[k] == 0) continue;
    const auto bins = static_cast<double>(h.counts.size());
    const int left =
        plot.x + static_cast<int>(std::lround(static_cast<double>(k) / bins * plot.width));
    const int right =
        plot.x + static_cast<int>(std::lround(static_cast<double>(k + 1) / bins * plot.width));
    const double log = std::log10(static_cast<double>(h.counts[k])) + 0.3;
    const int top =
        plot.y + plot.height - static_cast<int>(std::lround(plot.height * log / (most_log + 0.3)));
    const bool is_material = h.low + h.width * static_cast<double>(k) >= cut - h.width / 2;
    cv::rectangle(sheet, {left, top}, {std::max(left, right - 1), plot.y + plot.height - 1},
                  is_material ? cv::Scalar(200, 140, 40) : kBars, cv::FILLED);
  }
  draw_value_axis(sheet, plot, low, high);
  draw_threshold(sheet, preview, plot, low, high);
}

// A table; the first row is its head. Columns are as wide as their widest cell.
void draw_table(cv::Mat& sheet, const std::vector<std::vector<std::string>>& rows, int x, int y,
                std::size_t marked) {
  std::vector<int> right;
  int at = x;
  for (std::size_t c = 0; c < rows[0].size(); ++c) {
    int width = 0;
    for (const auto& row : rows)
      width = std::max(width, text_width(row[c], kSmall));
    right.push_back(at += width);
    at += 30;
  }
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const int line = y + static_cast<int>(r) * 24;
    for (std::size_t c = 0; c < rows[r].size(); ++c) {
      draw_text(sheet, rows[r][c], right[c], line, kSmall,
                r == 0        ? kFaint
                : r == marked ? kThreshold
                              : kText,
                Align::kRight);
    }
    if (r == 0) cv::line(sheet, {x, line + 8}, {right.back(), line + 8}, kLine, 1);
  }
}

std::string signed_text(double value) {
  char out[40];
  std::snprintf(out, sizeof out, "%+.4g", value);
  return value == 0 ? "0" : out;
}

std::string percent_text(double part, double whole) {
  if (!(whole > 0)) return "-";
  if (part == whole) return "0";
  char out[32];
  std::snprintf(out, sizeof out, "%+.1f %%", 100 * (part - whole) / whole);
  return out;
}

void draw_changes(cv::Mat& sheet, const Preview& preview, int x, int y) {
  const bool is_level = std::holds_alternative<Equalize>(preview.segmentation);
  const std::string what = is_level ? "level" : "threshold";
  draw_text(sheet, "Another " + what, x, y + 16, kNormal, kText);
  std::vector<std::vector<std::string>> rows{
      {"change", what, "area mm2", "difference", "outlines"}};
  for (const Change& c : preview.changes) {
    rows.push_back({signed_text(c.change), number_text(c.threshold), number_text(c.area_mm2, 6),
                    percent_text(c.area_mm2, preview.changes[2].area_mm2),
                    std::to_string(c.outlines)});
  }
  draw_table(sheet, rows, x, y + 52, 3);
  int line = y + 52 + 24 * 6 + 8;
  for (const std::string& text : wrapped(changes_text(preview), 0.42, kWidth - kMargin - x)) {
    draw_text(sheet, text, x, line, 0.42, kFaint);
    line += 18;
  }
}

constexpr std::size_t kLabelRows = 9, kLabelColumns = 4;

// Height of what is drawn below the slices.
int panel_height(const Preview& preview) {
  if (!std::holds_alternative<Labels>(preview.segmentation)) return kPanel;
  const std::size_t labels = preview.label_voxels.size();
  const std::size_t rows =
      std::min(labels, kLabelRows) + (labels > kLabelRows * kLabelColumns ? 1 : 0);
  return 50 + 24 * static_cast<int>(rows);
}

// The wanted labels, then as many others as there is room for.
void draw_labels(cv::Mat& sheet, const Preview& preview, int x, int y) {
  draw_text(sheet, "Voxels of " + slices_shown(preview) + ", by label (grey: not material)", x,
            y + 16, kNormal, kText);
  const auto& wanted = std::get<Labels>(preview.segmentation);
  std::vector<std::pair<int, std::int64_t>> rows;
  for (const bool is_wanted : {true, false}) {
    for (const auto& [label, voxels] : preview.label_voxels) {
      if ((wanted.all || wanted.labels.contains(label)) == is_wanted)
        rows.emplace_back(label, voxels);
    }
  }
  std::int64_t most = 1;
  for (const auto& row : rows)
    most = std::max(most, row.second);
  const std::size_t shown = std::min(rows.size(), kLabelRows * kLabelColumns);
  const int column = rows.size() <= kLabelRows ? 760 : 380;
  for (std::size_t r = 0; r < shown; ++r) {
    const int left = x + static_cast<int>(r / kLabelRows) * column,
              line = y + 50 + static_cast<int>(r % kLabelRows) * 24;
    const auto c = label_colour(preview, rows[r].first);
    const int most_width = column - 230;
    const int width = static_cast<int>(
        std::lround(static_cast<double>(rows[r].second) / static_cast<double>(most) * most_width));
    draw_text(sheet, std::to_string(rows[r].first), left + 40, line, kSmall, kText, Align::kRight);
    if (rows[r].second > 0)
      cv::rectangle(sheet, {left + 52, line - 13}, {left + 52 + width, line + 2},
                    cv::Scalar(c[0], c[1], c[2]), cv::FILLED);
    draw_text(sheet, std::to_string(rows[r].second), left + 60 + width, line, kSmall,
              rows[r].second > 0 ? kText : kWarning);
  }
  if (rows.size() > shown)
    draw_text(sheet, "and " + std::to_string(rows.size() - shown) + " more labels", x,
              y + 50 + static_cast<int>(kLabelRows) * 24, kSmall, kFaint);
}

std::string window_text(const Preview& preview, std::pair<double, double> window) {
  if (std::holds_alternative<Labels>(preview.segmentation)) return "colours: wanted labels";
  const std::string unit = preview.unit == PixelUnit::kHounsfield ? " HU" : "";
  return "window: centre " + number_text((window.first + window.second) / 2) + ", width " +
         number_text(window.second - window.first) + unit;
}

}  // namespace

std::vector<Warning> shown_warnings(const Preview& preview) {
  // Their sentences are fixed but for numbers.
  static constexpr std::array kPlain = {
      "copied_slice",      "gantry_tilt",      "localiser",       "looks_like_ct",
      "looks_like_labels", "looks_offset",     "missing_slice",   "no_modality",
      "no_orientation",    "no_pixel_spacing", "no_rescale",      "no_series_uid",
      "no_sop_uid",        "not_dicom",        "spacing_ignored", "threshold_out_of_range",
      "uneven_spacing",    "voxel_volume"};
  std::vector<Warning> out;
  for (const Warning& w : preview.warnings) {
    const bool is_plain = std::find(kPlain.begin(), kPlain.end(), w.code) != kPlain.end();
    const std::string sentence = is_plain ? w.sentence : "see the messages of the program";
    if (std::none_of(out.begin(), out.end(), [&](const Warning& other) {
          return other.code == w.code && other.sentence == sentence;
        }))
      out.push_back({w.code, "", sentence});
  }
  return out;
}

std::string changes_text(const Preview& preview) {
  return "Sums over " + slices_shown(preview) +
         (preview.has_solid ? ", of the contours before simplification and without solid bone."
                            : ", of the contours before simplification.");
}

std::string number_text(double value, int digits) {
  char out[40];
  std::snprintf(out, sizeof out, "%.*g", digits, value);
  // Areas of more digits than wanted are whole numbers and not powers of ten.
  if (std::abs(value) >= std::pow(10.0, digits) && std::abs(value) < 1e15)
    std::snprintf(out, sizeof out, "%.0f", value);
  return out;
}

std::array<std::uint8_t, 3> label_colour(const Preview& preview, int label) {
  static constexpr std::array<std::array<std::uint8_t, 3>, 7> kColours{{{230, 159, 0},
                                                                        {86, 180, 233},
                                                                        {0, 158, 115},
                                                                        {240, 228, 66},
                                                                        {0, 114, 178},
                                                                        {213, 94, 0},
                                                                        {204, 121, 167}}};
  const auto* labels = std::get_if<Labels>(&preview.segmentation);
  if (labels == nullptr || !(labels->all || labels->labels.contains(label))) return {95, 98, 102};
  std::ptrdiff_t place = 0;
  if (labels->all) {
    place = std::distance(preview.label_voxels.begin(), preview.label_voxels.find(label));
  } else {
    place = std::distance(labels->labels.begin(), labels->labels.find(label));
  }
  return kColours[static_cast<std::size_t>(place) % kColours.size()];
}

std::string size_text(const Preview& preview, const Crop& view) {
  const SlicePlane& plane = preview.shown[0].plane;
  const auto sides = [&](int width, int height) {
    return number_text(width * plane.spacing_u_mm) + " x " +
           number_text(height * plane.spacing_v_mm) + " mm";
  };
  std::string out =
      std::to_string(preview.slices) + (preview.slices == 1 ? " slice" : " slices") + " of " +
      std::to_string(preview.width) + " x " + std::to_string(preview.height) + " pixels of " +
      number_text(plane.spacing_u_mm) + " x " + number_text(plane.spacing_v_mm) + " mm";
  if (preview.slices > 1) out += ", " + number_text(preview.step_mm) + " mm apart";
  return out + "; whole slice " + sides(preview.width, preview.height) + ", shown " +
         sides(view.x1 - view.x0 + 1, view.y1 - view.y0 + 1);
}

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
  constexpr std::size_t kMostWarningLines = 12;
  if (warnings.size() > kMostWarningLines) {
    warnings.resize(kMostWarningLines - 1);
    warnings.emplace_back("... more warnings on the terminal");
  }
  const int head =
      kMargin + 30 * static_cast<int>(title.size()) + 24 * static_cast<int>(lines.size()) + 12;
  const int panel = head + grid.rows * (grid.tile_height + kCaption + kGap) + 4;
  const int foot = panel + panel_height(preview) + 20 * static_cast<int>(warnings.size()) +
                   (warnings.empty() ? 0 : kMargin);
  cv::Mat sheet(foot, kWidth, CV_8UC3, kBackground);

  int y = kMargin + 14;
  for (const std::string& line : title) {
    draw_text(sheet, line, kMargin, y, kLarge, kText);
    y += 30;
  }
  for (const std::string& line : lines) {
    draw_text(sheet, line, kMargin, y, kNormal, kFaint);
    y += 24;
  }
  const int used = grid.columns * grid.cell_width + (grid.columns - 1) * kGap;
  const int left = kMargin + (inner - used) / 2;
  for (int i = 0; i < slices; ++i) {
    Tile tile{left + i % grid.columns * (grid.cell_width + kGap),
              head + i / grid.columns * (grid.tile_height + kCaption + kGap), grid.tile_width,
              grid.tile_height};
    out.tiles.push_back(tile);
  }
  // Each slice has its own part of the picture.
  for_each_piece(slices, [&](int i) {
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

  if (std::holds_alternative<Labels>(preview.segmentation)) {
    draw_labels(sheet, preview, kMargin, panel);
  } else {
    draw_histogram(sheet, preview, kMargin, panel);
    draw_changes(sheet, preview, kMargin + 980, panel);
  }
  y = panel + panel_height(preview) + 8;
  for (const std::string& line : warnings) {
    draw_text(sheet, line, kMargin, y, kSmall, kWarning);
    y += 20;
  }
  out.picture = {sheet.cols, sheet.rows, std::vector<std::uint8_t>(sheet.datastart, sheet.dataend)};
  return out;
}

}  // namespace trocar::pipeline
