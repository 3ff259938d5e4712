// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/preview_sheet.h"

#include <sodium.h>
#include <spng.h>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "embedded/pipeline/preview/preview_page.js.h"
#include "formats/base/html_page.h"
#include "formats/base/json.h"

namespace trocar::pipeline {
namespace {

using nlohmann::json;

// All colours are RGB.
const cv::Scalar kBackground(20, 22, 25), kText(228, 230, 233), kFaint(150, 155, 162),
    kLine(70, 74, 80), kOutlineColour(255, 165, 0), kThreshold(255, 165, 0), kBars(120, 140, 160),
    kMaterialBars(200, 140, 40), kWarning(255, 205, 90), kLabel(160, 225, 255);

// All colours are RGB.
constexpr int kWidth = 1600, kMargin = 24;  // pixels

// All colours are RGB.
constexpr double kSmall = 0.46, kNormal = 0.54, kLarge = 0.85;  // font scales of OpenCV

enum class Align { kLeft, kCentre, kRight };

constexpr const char* kSoftware = "trocar-mesh preview";

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

std::string ascii(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if ((byte & 0xC0U) != 0x80U) out += byte >= 32 && byte < 127 ? c : '?';
  }
  return out;
}

int aligned(int x, int width, Align align) {
  return align == Align::kLeft ? x : x - (align == Align::kCentre ? width / 2 : width);
}

// Width in pixels of an ASCII text. In all functions of this header, `size` is a font scale.
int text_width(const std::string& text, double size) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, size, 1, &baseline).width;
}

// Draws a text whose baseline is y pixels below the upper edge. Depending on `align`, the left
// end, the middle or the right end of the text is at x. Characters that are not printable ASCII
// become question marks.
void draw_text(cv::Mat& on, const std::string& text, int x, int y, double size,
               const cv::Scalar& colour, Align align = Align::kLeft) {
  const std::string drawn = ascii(text);
  cv::putText(on, drawn, {aligned(x, text_width(drawn, size), align), y}, kFont, size, colour,
              size > 0.8 ? 2 : 1, cv::LINE_AA);
}

// Draws lines of text below each other: the first one's baseline is at y, and baselines are
// `height` pixels apart. Returns the y of a further line.
int draw_lines(cv::Mat& on, const std::vector<std::string>& lines, int x, int y, double size,
               const cv::Scalar& colour, int height) {
  for (const std::string& line : lines) {
    draw_text(on, line, x, y, size, colour);
    y += height;
  }
  return y;
}

// Like draw_text(), but in light blue with a dark border, so that the text is legible on any
// image.
void draw_label(cv::Mat& on, const std::string& text, int x, int y, double size, Align align) {
  const std::string drawn = ascii(text);
  const cv::Point at(aligned(x, text_width(drawn, size), align), y);
  cv::putText(on, drawn, at, kFont, size, cv::Scalar(0, 0, 0), 4, cv::LINE_AA);
  cv::putText(on, drawn, at, kFont, size, kLabel, 1, cv::LINE_AA);
}

// The text broken into lines of at most `width` pixels. As in draw_text(), characters that are not
// printable ASCII become question marks. A word that is too long for a line is broken too.
std::vector<std::string> wrapped(const std::string& text, double size, int width) {
  std::vector<std::string> out(1);
  const std::string drawn = ascii(text) + " ";
  for (std::size_t at = 0; at < drawn.size();) {
    const std::size_t end = drawn.find(' ', at);
    std::string word = drawn.substr(at, end - at);
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

// The largest number not above `value` that is 1, 2 or 5 times a power of ten. Such a number is a
// good distance between the marks of an axis.
double nice_below(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {5.0, 2.0}) {
    if (value >= factor * power) return factor * power;
  }
  return power;
}

constexpr int kPanel = 300;  // height, pixels
constexpr std::size_t kLabelRows = 9, kLabelColumns = 4;

struct Plot {
  int x = 0, y = 0, width = 0, height = 0;  // x and y of the upper left corner
};

void draw_grid_lines(cv::Mat& sheet, const Plot& plot, double max_log) {
  for (int power = 0; power <= static_cast<int>(max_log); ++power) {
    const int y = plot.y + plot.height -
                  static_cast<int>(std::lround(plot.height * (power + 0.3) / (max_log + 0.3)));
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
  constexpr int kMax = 20;
  for (int k = 0; k < kMax && first + k * step <= high; ++k) {
    const double tick = first + k * step;
    const int x = plot.x + static_cast<int>(std::lround((tick - low) / (high - low) * plot.width));
    cv::line(sheet, {x, base}, {x, base + 5}, kFaint, 1);
    draw_text(sheet, number_text(std::abs(tick) < step / 1e6 ? 0 : tick), x, base + 20, 0.42,
              kFaint, Align::kCentre);
  }
}

// Marks the threshold. With equalisation, marks the range of values that the level has in the
// slices shown.
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

void draw_histogram(cv::Mat& sheet, const Preview& preview, int x, int y) {
  const Histogram& h = preview.histogram;
  draw_text(
      sheet,
      "Pixels of " + slices_shown(preview) + ", by value in " + unit_name(preview) + " (log scale)",
      x, y + 16, kNormal, kText);
  const Plot plot{x + 56, y + 56, 820, kPanel - 96};
  const double low = h.low, high = h.low + h.width * static_cast<double>(h.counts.size());
  const std::int64_t most = *std::max_element(h.counts.begin(), h.counts.end());
  const double max_log = std::max(1.0, std::log10(static_cast<double>(most)));
  draw_grid_lines(sheet, plot, max_log);
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
        plot.y + plot.height - static_cast<int>(std::lround(plot.height * log / (max_log + 0.3)));
    const bool is_material = h.low + h.width * static_cast<double>(k) >= cut - h.width / 2;
    cv::rectangle(sheet, {left, top}, {std::max(left, right - 1), plot.y + plot.height - 1},
                  is_material ? kMaterialBars : kBars, cv::FILLED);
  }
  draw_value_axis(sheet, plot, low, high);
  draw_threshold(sheet, preview, plot, low, high);
}

// Draws a table whose first row is the head. Columns are as wide as their widest cell.
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
  draw_lines(sheet, wrapped(changes_text(preview), 0.42, kWidth - kMargin - x), x,
             y + 52 + 24 * 6 + 8, 0.42, kFaint, 18);
}

// Colour of a label that is material, RGB; grey for other labels. There are seven colours (of
// Okabe and Ito), which people with the usual kinds of colour blindness can distinguish. From the
// eighth label on, colours are repeated.
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
  const auto position =
      labels->all ? std::distance(preview.label_voxels.begin(), preview.label_voxels.find(label))
                  : std::distance(labels->labels.begin(), labels->labels.find(label));
  return kColours[static_cast<std::size_t>(position) % kColours.size()];
}

// Draws the wanted labels, then as many others as fit.
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
    const int max_width = column - 230;
    const int width = static_cast<int>(
        std::lround(static_cast<double>(rows[r].second) / static_cast<double>(most) * max_width));
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

// Height of the panel, pixels.
int panel_height(const Preview& preview) {
  if (!std::holds_alternative<Labels>(preview.segmentation)) return kPanel;
  const std::size_t labels = preview.label_voxels.size();
  const std::size_t rows =
      std::min(labels, kLabelRows) + (labels > kLabelRows * kLabelColumns ? 1 : 0);
  return 50 + 24 * static_cast<int>(rows);
}

// Draws the panel with its upper edge at y.
void draw_panel(cv::Mat& sheet, const Preview& preview, int y) {
  if (std::holds_alternative<Labels>(preview.segmentation)) {
    draw_labels(sheet, preview, kMargin, y);
  } else {
    draw_histogram(sheet, preview, kMargin, y);
    draw_changes(sheet, preview, kMargin + 980, y);
  }
}

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

Result<std::vector<std::uint8_t>> png_of(const Picture& picture) {
  const std::unique_ptr<spng_ctx, void (*)(spng_ctx*)> png(spng_ctx_new(SPNG_CTX_ENCODER),
                                                           spng_ctx_free);
  if (!png) return refused_for_now("not enough memory for the preview");
  const auto failed = [](int error) {
    return bug(std::string("the preview's PNG: ") + spng_strerror(error));
  };
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(picture.width);
  header.height = static_cast<std::uint32_t>(picture.height);
  header.bit_depth = 8;
  header.color_type = SPNG_COLOR_TYPE_TRUECOLOR;
  spng_set_option(png.get(), SPNG_ENCODE_TO_BUFFER, 1);
  // Higher levels take several times as long and make files only a few per cent smaller.
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
  // The text chunk precedes the pixels.
  std::string head(256, '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(in.gcount()));
  return head.find(std::string("tEXtSoftware") + '\0' + kSoftware) != std::string::npos;
}

std::string png_url(std::span<const std::uint8_t> png) {
  std::string out(sodium_base64_ENCODED_LEN(png.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(out.data(), out.size(), png.data(), png.size(), sodium_base64_VARIANT_ORIGINAL);
  out.pop_back();  // the final zero
  return "data:image/png;base64," + out;
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
