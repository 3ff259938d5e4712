// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/fit_page.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "formats/base/html_text.h"
#include "formats/base/text_line.h"
#include "runtime/calibration/fitted_tissue.h"

namespace trocar::runtime {
namespace {

struct ParameterRow {
  std::string name, value, interval;
};

ParameterRow row_of(const char* name, const FittedValue& x, const char* unit) {
  ParameterRow row{name, text_line("%.4g %s", x.value, unit),
                   text_line("%.4g to %.4g %s", x.low, x.high, unit)};
  if (std::isinf(x.high)) {
    row.value = text_line("at least %.4g %s", x.low, unit);
    row.interval = "the rise has too few points";
  }
  return row;
}

std::vector<ParameterRow> rows_of(const CurveFit& fit) {
  std::vector<ParameterRow> rows;
  rows.push_back(row_of("stiffness before cutting", fit.stiffness_N_per_mm, "N/mm"));
  if (fit.layer_N) rows.push_back(row_of("force of the hard layer", *fit.layer_N, "N"));
  if (fit.layer_mm) rows.push_back(row_of("thickness of the hard layer", *fit.layer_mm, "mm"));
  rows.push_back(row_of("cutting force of the tip", fit.cutting_N, "N"));
  rows.push_back(
      row_of(fit.drift_N_per_mm ? "friction per length" : "friction per length and drift",
             fit.friction_N_per_mm, "N/mm"));
  if (fit.drift_N_per_mm)
    rows.push_back(row_of("drift of the cutting force", *fit.drift_N_per_mm, "N/mm"));
  return rows;
}

std::vector<std::string> notes_of(const CurveFit& fit) {
  std::vector<std::string> notes{
      "The cutting force is one product of pressure, area, face friction and tearing.",
      "Friction per length is one product of friction coefficient, pressure and circumference."};
  if (fit.drift_N_per_mm)
    notes.push_back(text_line("The cutting force holds %.3g mm below the surface.", fit.middle_mm));
  else
    notes.emplace_back(
        "Without a withdrawal, friction and a drift of the cutting force are one slope.");
  if (!fit.layer_N) notes.emplace_back("The curve shows no hard layer at the surface.");
  if (const std::string shell = fitted_shell(fit); !shell.empty())
    notes.push_back("The hard layer is, in a scene's body: \"shell\": " + shell);
  notes.push_back(text_line("Contact at %.3f mm; force before contact %.3g N.", fit.contact_mm,
                            fit.baseline_N));
  notes.push_back(text_line(
      "Residuals: %.3g N rms, of which structure %.3g N correlated over %.2g mm; noise %.3g N. "
      "The fit explains %.1f %% of the variance.",
      fit.rms_N, fit.structure_N, fit.correlation_mm, fit.noise_N, 100 * fit.explained));
  return notes;
}

/// A plot in SVG.
class Plot {
 public:
  Plot(double low_x, double high_x, double low_y, double high_y, double height)
      : low_x_(low_x), high_x_(high_x), low_y_(low_y), high_y_(high_y), height_(height) {
    svg_ = text_line("<svg viewBox=\"0 0 %g %g\" role=\"img\">\n", kWidth, height_ + 40);
    for (const double y : ticks(low_y, high_y))
      svg_ += text_line(
          "<line class=\"grid\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/><text x=\"%g\" "
          "y=\"%.1f\" "
          "text-anchor=\"end\">%g</text>\n",
          kLeft, kWidth, at_y(y), at_y(y), kLeft - 6, at_y(y) + 4, y);
    for (const double x : ticks(low_x, high_x))
      svg_ += text_line("<text x=\"%.1f\" y=\"%g\" text-anchor=\"middle\">%g</text>\n", at_x(x),
                        height_ + 18, x);
  }
  void dot(double x, double y, const char* kind) {
    svg_ += text_line("<circle class=\"%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"1.8\"/>\n", kind, at_x(x),
                      at_y(y));
  }
  void begin_line() { svg_ += "<polyline points=\""; }
  void corner(double x, double y) { svg_ += text_line("%.1f,%.1f ", at_x(x), at_y(y)); }
  void end_line() { svg_ += "\"/>\n"; }
  std::string finish(const char* label) const {
    return svg_ +
           text_line(
               "<text x=\"%g\" y=\"14\">%s</text><text x=\"%g\" y=\"%g\" text-anchor=\"end\">depth "
               "(mm)</text></svg>\n",
               kLeft + 4, label, kWidth - 4, height_ + 36);
  }

 private:
  static constexpr double kWidth = 900, kLeft = 56;

  static std::vector<double> ticks(double low, double high) {
    const double raw = (high - low) / 6, power = std::pow(10, std::floor(std::log10(raw)));
    const double step = power * (raw / power < 2 ? 2 : raw / power < 5 ? 5 : 10);
    std::vector<double> found;
    for (double k = std::ceil(low / step); k * step <= high && found.size() < 20; ++k)
      found.push_back(k * step + 0.0);
    return found;
  }
  double at_x(double x) const {
    return kLeft + (x - low_x_) / (high_x_ - low_x_) * (kWidth - kLeft - 10);
  }
  double at_y(double y) const {
    return height_ - (y - low_y_) / (high_y_ - low_y_) * (height_ - 24);
  }

  double low_x_, high_x_, low_y_, high_y_, height_;
  std::string svg_;
};

const char* kind_of(const FittedPoint& point) {
  return !point.is_used ? "left-out" : point.is_withdrawal ? "out" : "in";
}

std::string plots(const CurveFit& fit) {
  double low_x = HUGE_VAL, high_x = -HUGE_VAL, low_N = 0, high_N = 0, max_N = 1e-9;
  for (const FittedPoint& point : fit.points) {
    low_x = std::min(low_x, point.depth_mm);
    high_x = std::max(high_x, point.depth_mm);
    low_N = std::min(low_N, point.force_N);
    high_N = std::max(high_N, point.force_N);
    if (point.is_used) max_N = std::max(max_N, std::abs(point.force_N - point.fitted_N));
  }
  Plot forces(low_x, high_x, low_N, high_N, 380), residuals(low_x, high_x, -max_N, max_N, 200);
  for (const FittedPoint& point : fit.points) {
    forces.dot(point.depth_mm, point.force_N, kind_of(point));
    if (point.is_used)
      residuals.dot(point.depth_mm, point.force_N - point.fitted_N, kind_of(point));
  }
  for (const bool is_withdrawal : {false, true}) {
    forces.begin_line();
    for (const FittedPoint& point : fit.points)
      if (point.is_withdrawal == is_withdrawal && (point.is_used || !is_withdrawal))
        forces.corner(point.depth_mm, point.fitted_N);
    forces.end_line();
  }
  return forces.finish("force (N)") + residuals.finish("measured minus fitted force (N)");
}

constexpr const char* kHead =
    "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Fit of a force-depth "
    "curve</title>\n"
    "<style>body{font:15px sans-serif;max-width:960px;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse}td,th{text-align:left;padding:.2em 1.2em .2em 0}"
    "svg{width:100%;font-size:12px}.grid{stroke:#ddd}.in{fill:#2a6fbb}.out{fill:#3a9a5b}.left-out{"
    "fill:#bbb}"
    "polyline{fill:none;stroke:#c33;stroke-width:1.5}pre{background:#f4f4f4;padding:1em}</style></"
    "head><body>\n";

}  // namespace

std::string fit_text(const CurveFit& fit) {
  std::string text = text_line("%-32s%-24s%s\n", "parameter", "value", "90 % interval");
  for (const ParameterRow& row : rows_of(fit))
    text += text_line("%-32s%-24s%s\n", row.name.c_str(), row.value.c_str(), row.interval.c_str());
  for (const std::string& note : notes_of(fit))
    text += note + "\n";
  return text;
}

std::string fit_page(const CurveFit& fit, const std::string& name, const std::string& tissue) {
  std::string page = kHead;
  page += "<h1>Fit of " + html_text(name) + "</h1>\n" + plots(fit);
  page +=
      "<p>Blue: insertion. Green: withdrawal. Grey: left out of the fit. Red: the fit.</p>\n"
      "<table><tr><th>parameter</th><th>value</th><th>90 % interval</th></tr>\n";
  for (const ParameterRow& row : rows_of(fit))
    page += "<tr><td>" + html_text(row.name) + "</td><td>" + html_text(row.value) + "</td><td>" +
            html_text(row.interval) + "</td></tr>\n";
  page += "</table>\n<ul>\n";
  for (const std::string& note : notes_of(fit))
    page += "<li>" + html_text(note) + "</li>\n";
  page += "</ul>\n<p>The tissue for a scene:</p><pre>";
  // Line by line, because html_text() turns a line feed into a space.
  for (std::size_t begin = 0; begin < tissue.size();) {
    const std::size_t end = std::min(tissue.find('\n', begin), tissue.size());
    page += html_text(tissue.substr(begin, end - begin)) + "\n";
    begin = end + 1;
  }
  return page + "</pre>\n</body></html>\n";
}

}  // namespace trocar::runtime
