// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/preview/sheet_drawing.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace trocar::pipeline {
namespace {

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

}  // namespace

int text_width(const std::string& text, double size) {
  int baseline = 0;
  return cv::getTextSize(text, kFont, size, 1, &baseline).width;
}

void draw_text(cv::Mat& on, const std::string& text, int x, int y, double size,
               const cv::Scalar& colour, Align align) {
  const std::string drawn = ascii(text);
  cv::putText(on, drawn, {aligned(x, text_width(drawn, size), align), y}, kFont, size, colour,
              size > 0.8 ? 2 : 1, cv::LINE_AA);
}

int draw_lines(cv::Mat& on, const std::vector<std::string>& lines, int x, int y, double size,
               const cv::Scalar& colour, int height) {
  for (const std::string& line : lines) {
    draw_text(on, line, x, y, size, colour);
    y += height;
  }
  return y;
}

void draw_label(cv::Mat& on, const std::string& text, int x, int y, double size, Align align) {
  const std::string drawn = ascii(text);
  const cv::Point at(aligned(x, text_width(drawn, size), align), y);
  cv::putText(on, drawn, at, kFont, size, cv::Scalar(0, 0, 0), 4, cv::LINE_AA);
  cv::putText(on, drawn, at, kFont, size, kLabel, 1, cv::LINE_AA);
}

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

double nice_below(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {5.0, 2.0}) {
    if (value >= factor * power) return factor * power;
  }
  return power;
}

}  // namespace trocar::pipeline
