// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/sheet_panels.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "pipeline/preview/preview_text.h"
#include "pipeline/preview/sheet_drawing.h"

namespace trocar::pipeline {
namespace {

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

}  // namespace

int panel_height(const Preview& preview) {
  if (!std::holds_alternative<Labels>(preview.segmentation)) return kPanel;
  const std::size_t labels = preview.label_voxels.size();
  const std::size_t rows =
      std::min(labels, kLabelRows) + (labels > kLabelRows * kLabelColumns ? 1 : 0);
  return 50 + 24 * static_cast<int>(rows);
}

void draw_panel(cv::Mat& sheet, const Preview& preview, int y) {
  if (std::holds_alternative<Labels>(preview.segmentation)) {
    draw_labels(sheet, preview, kMargin, y);
  } else {
    draw_histogram(sheet, preview, kMargin, y);
    draw_changes(sheet, preview, kMargin + 980, y);
  }
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
  const auto position =
      labels->all ? std::distance(preview.label_voxels.begin(), preview.label_voxels.find(label))
                  : std::distance(labels->labels.begin(), labels->labels.find(label));
  return kColours[static_cast<std::size_t>(position) % kColours.size()];
}

}  // namespace trocar::pipeline
