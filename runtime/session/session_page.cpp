// SPDX-License-Identifier: Apache-2.0
// The page of a session report. Its figures: session_report.h.
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "formats/base/html_text.h"
#include "formats/base/json_text.h"
#include "formats/session/fault_words.h"
#include "runtime/session/session_report.h"
#include "runtime/session/text_line.h"

namespace trocar::runtime {
namespace {

constexpr const char* kStyle =
    R"(:root{color-scheme:light dark;--page:#fff;--ink:#1a1c1e;--soft:#5c6268;--rule:#d4d8dc;--card:#f3f5f7;
--force:#0066a8;--mark:#c04a00;--plan:#007a5a;--zone:#a8407f;--bone:#9a8a5c;--good:#00694d;--bad:#b02a00}
@media (prefers-color-scheme:dark){:root{--page:#15181b;--ink:#e8eaec;--soft:#a3aab1;--rule:#3a4046;--card:#20252a;
--force:#5ab4f0;--mark:#f59a4c;--plan:#3ed0a4;--zone:#e38dc4;--bone:#cdbd8c;--good:#4fd3a8;--bad:#ff9a7a}}
@media print{:root{--page:#fff;--ink:#000;--soft:#444;--rule:#bbb;--card:#fff;--force:#0066a8;--mark:#c04a00;--plan:#007a5a;
--zone:#a8407f;--bone:#9a8a5c;--good:#00694d;--bad:#b02a00}section,figure,tr{break-inside:avoid}}
*{box-sizing:border-box}body{margin:0 auto;padding:24px;max-width:1120px;background:var(--page);color:var(--ink);
font:16px/1.45 system-ui,"DejaVu Sans",sans-serif}
h1{font-size:26px;margin:0 0 4px}h2{font-size:19px;margin:28px 0 8px;border-bottom:1px solid var(--rule);padding-bottom:4px}
p{margin:6px 0;max-width:80ch}.soft{color:var(--soft)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(128px,1fr));gap:10px;margin:16px 0}
.tile{background:var(--card);border:1px solid var(--rule);border-radius:6px;padding:10px 12px}
.tile b{display:block;font-size:22px;font-variant-numeric:tabular-nums}.tile span{color:var(--soft);font-size:14px}
table{border-collapse:collapse;width:100%;font-size:15px}th,td{text-align:left;padding:5px 10px 5px 0;vertical-align:top;
border-bottom:1px solid var(--rule)}th{font-weight:600;color:var(--soft)}td.n,th.n{text-align:right;font-variant-numeric:tabular-nums;
white-space:nowrap}.wide{overflow-x:auto}
.met{color:var(--good)}.miss{color:var(--bad)}.met,.miss{font-weight:600;white-space:nowrap}
.pair{display:grid;grid-template-columns:1fr 1fr;gap:16px}@media (max-width:760px){.pair{grid-template-columns:1fr}}
figure{margin:0}figcaption{font-size:14px;color:var(--soft)}svg{width:100%;height:auto;display:block}
svg text{fill:var(--ink);font-size:13px}svg .soft{fill:var(--soft)}svg .end{text-anchor:end}svg .mid{text-anchor:middle}
.axis{stroke:var(--soft);fill:none}.grid{stroke:var(--rule);fill:none}.force{stroke:var(--force);fill:none;stroke-width:1.8}
.path{stroke:var(--force);fill:none;stroke-width:2}.mark{fill:var(--mark)}.markline{stroke:var(--mark);stroke-dasharray:2 4}
.plan{stroke:var(--plan);fill:none;stroke-width:1.6;stroke-dasharray:7 4}.aim{stroke:var(--plan);fill:none;stroke-width:2}
.zone{fill:var(--zone);fill-opacity:.25;stroke:var(--zone)}.zonetext{fill:var(--zone)!important}
.layer{fill:var(--mark);fill-opacity:.12}.bone{stroke:var(--bone);stroke-width:3.5;stroke-linecap:butt}.sheet{stroke:var(--rule)}
.limit{stroke:var(--plan);stroke-dasharray:7 4})";

std::string in_mm(double m) {
  return text_line("%.2f mm", 1e3 * m);
}
std::string in_mm(const std::optional<double>& m) {
  return m ? in_mm(*m) : "none";
}
std::string in_s(double s) {
  return text_line("%.3f s", s);
}
std::string with_unit(double value, const std::string& unit) {
  return unit == "m"   ? in_mm(value)
         : unit == "N" ? text_line("%.2f N", value)
                       : text_line("%.3f ", value) + unit;
}

std::string name_of(const Scene& scene, const ReportFacts& facts, const Punctured& what) {
  if (what.is_layer) return "layer " + scene.layers[what.index].name;
  const ReportSheet& sheet = facts.sheets[what.index];
  return "slice " + std::to_string(sheet.slice) +
         (sheet.tissue.empty() ? "" : " (" + sheet.tissue + ")");
}

/// Rows of a table, each cell escaped; `heads` that begin with '#' are of numbers.
class Table {
 public:
  explicit Table(std::vector<std::string> heads) : heads_(std::move(heads)) {
    text_ = "<div class=\"wide\"><table><thead><tr>";
    for (const std::string& head : heads_)
      text_ += is_number(head) ? "<th class=\"n\">" + html_text(head.substr(1)) + "</th>"
                               : "<th>" + html_text(head) + "</th>";
    text_ += "</tr></thead><tbody>\n";
  }
  void row(const std::vector<std::string>& cells, const std::string& last_class = "") {
    text_ += "<tr>";
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::string kind = is_number(heads_[i]) ? "n" : i == 0 ? last_class : "";
      text_ +=
          (kind.empty() ? "<td>" : "<td class=\"" + kind + "\">") + html_text(cells[i]) + "</td>";
    }
    text_ += "</tr>\n";
  }
  std::string text() const { return text_ + "</tbody></table></div>\n"; }

 private:
  static bool is_number(const std::string& head) { return !head.empty() && head[0] == '#'; }
  std::vector<std::string> heads_;
  std::string text_;
};

/// A step of 1, 2 or 5 times a power of ten, with at most `most` of them in the range.
double nice_step(double range, int most) {
  const double least = std::max(range, 1e-9) / most;
  const double power = std::pow(10.0, std::floor(std::log10(least)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= least) return factor * power;
  }
  return 10 * power;
}

/// The multiples of `step` from `low` to `high`.
std::vector<double> ticks_of(double low, double high, double step) {
  const double first = std::ceil(low / step);
  std::vector<double> out;
  for (int k = 0; k < 1000 && (first + k) * step <= high; ++k)
    out.push_back((first + k) * step);
  return out;
}

std::string number(double x) {
  return text_line("%.6g", std::abs(x) < 1e-12 ? 0.0 : x);
}

/// A plot of force over something.
struct Plot {
  static constexpr double kLeft = 58, kTop = 14, kWidth = 560, kHeight = 300, kBottom = 46;
  double low = 0, high = 1, force_high = 1;

  double x(double value) const {
    return kLeft + (value - low) / (high - low) * (kWidth - kLeft - 12);
  }
  double y(double force_N) const {
    return kHeight - kBottom - force_N / force_high * (kHeight - kBottom - kTop);
  }
  std::string axes(const std::string& what) const {
    std::string out;
    const double step = nice_step(high - low, 8), force_step = nice_step(force_high, 6);
    for (const double at : ticks_of(low, high * (1 + 1e-9) + 1e-12, step)) {
      out += text_line("<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>",
                       x(at), x(at), kTop, kHeight - kBottom);
      out += text_line("<text class=\"mid\" x=\"%.1f\" y=\"%.1f\">%s</text>", x(at),
                       kHeight - kBottom + 17, number(at).c_str());
    }
    for (const double at : ticks_of(0, force_high * (1 + 1e-9), force_step)) {
      out += text_line("<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>",
                       kLeft, kWidth - 12, y(at), y(at));
      out += text_line("<text class=\"end\" x=\"%.1f\" y=\"%.1f\">%s</text>", kLeft - 6, y(at) + 4,
                       number(at).c_str());
    }
    out += text_line("<text class=\"mid\" x=\"%.1f\" y=\"%.1f\">%s</text>", (kLeft + kWidth) / 2,
                     kHeight - 8, what.c_str());
    return out + text_line(
                     "<text class=\"mid\" transform=\"translate(14 %.1f) rotate(-90)\">force on "
                     "the hand (N)</text>\n",
                     (kHeight - kBottom + kTop) / 2);
  }
};

std::string force_plot(const Scene& scene, const SessionFigures& f, bool over_depth) {
  const auto place = [&](double t_s, double z_m) {
    return over_depth ? 1e3 * (f.top_z_m - z_m) : t_s;
  };
  Plot plot;
  plot.low = std::numeric_limits<double>::infinity();
  plot.high = -plot.low;
  plot.force_high = std::max(1.0, f.force_max_N);
  for (const ReportSample& s : f.samples) {
    plot.low = std::min(plot.low, place(s.t_s, s.tip_m[2]));
    plot.high = std::max(plot.high, place(s.t_s, s.tip_m[2]));
  }
  const double ceiling = scene.goals ? scene.goals->force_max_N.value_or(0) : 0;  // 0: none
  plot.force_high = std::max(plot.force_high, ceiling);
  plot.force_high *= 1.06;
  if (!(plot.high > plot.low)) plot.high = plot.low + 1;
  const char* what =
      over_depth ? "depth of the tip below the topmost slice or layer (mm)" : "time (s)";
  std::string out = text_line(
      "<figure><svg viewBox=\"0 0 %.0f %.0f\" role=\"img\" aria-label=\"Force on the hand over "
      "%s\">\n",
      Plot::kWidth, Plot::kHeight, over_depth ? "depth" : "time");
  out += plot.axes(what);
  if (ceiling > 0)
    out += text_line("<line class=\"limit\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>",
                     Plot::kLeft, Plot::kWidth - 12, plot.y(ceiling), plot.y(ceiling));
  std::string points;
  for (const ReportSample& s : f.samples)
    points += text_line("%.1f,%.1f ", plot.x(place(s.t_s, s.tip_m[2])), plot.y(s.force_N));
  out += "<polyline class=\"force\" points=\"" + points + "\"/>\n";
  for (const ReportPuncture& p : f.punctures) {
    const double x = plot.x(place(p.t_s, p.tip_z_m)), y = plot.y(p.force_N);
    out += text_line("<path class=\"mark\" d=\"M%.1f %.1fl-5 -9h10z\"/>", x, y - 1);
  }
  return out +
         text_line(
             "</svg><figcaption>Force over %s. Triangles: punctures%s.</figcaption></figure>\n",
             over_depth ? "depth, in and out" : "time",
             ceiling > 0 ? "; dashed: the force ceiling" : "");
}

/// One side view: x or y to the right, z up, the same scale both ways.
class SideView {
 public:
  SideView(const Scene& scene, const SessionFigures& f, const ReportFacts& facts, int axis)
      : scene_(scene), f_(f), facts_(facts), axis_(axis) {
    for (const ReportSample& s : f.samples)
      include(s.tip_m);
    for (const ReportSheet& sheet : facts.sheets) {
      low_z_ = std::min(low_z_, sheet.z_m);
      high_z_ = std::max(high_z_, sheet.z_m);
    }
    if (scene.goals && scene.goals->target) include(scene.goals->target->at_m);
    if (scene.goals && scene.goals->line) include(scene.goals->line->entry_m);
    if (!(high_z_ > low_z_)) low_z_ = high_z_ - 0.01;
    const double pad = 0.06 * (high_z_ - low_z_) + 1e-3;
    low_z_ -= pad;
    high_z_ += pad;
    low_u_ -= pad;
    high_u_ += pad;
    const double height = kHeight - kTop - kBottom, width = kWidth - kLeft - kRight;
    const double least_width = 0.03;
    scale_ = std::min(height / (high_z_ - low_z_), width / std::max(least_width, high_u_ - low_u_));
    const double middle = (low_u_ + high_u_) / 2;
    low_u_ = middle - width / scale_ / 2;
    high_u_ = middle + width / scale_ / 2;
    const double middle_z = (low_z_ + high_z_) / 2;
    low_z_ = middle_z - height / scale_ / 2;
    high_z_ = middle_z + height / scale_ / 2;
  }

  std::string draw() const {
    const std::string id = axis_ == 0 ? "clipx" : "clipy";
    std::string out = text_line(
        "<figure><svg viewBox=\"0 0 %.0f %.0f\" role=\"img\" aria-label=\"The tip's path seen "
        "along %s\"><defs><clipPath id=\"%s\"><rect x=\"%.0f\" y=\"%.0f\" width=\"%.0f\" "
        "height=\"%.0f\"/></clipPath></defs>\n",
        kWidth, kHeight, axis_ == 0 ? "y" : "x", id.c_str(), kLeft, kTop, kWidth - kLeft - kRight,
        kHeight - kTop - kBottom);
    out += axes() + "<g clip-path=\"url(#" + id + ")\">\n" + layers() + sheets() + zones() +
           plan() + path() + "</g>\n" + labels();
    return out + text_line(
                     "</svg><figcaption>Seen along %s: %s to the right, height up, the same scale "
                     "both ways. Line: the tip; dots: punctures; bars: the slices' material before "
                     "the session, in the plane %s = %.1f mm%s.</figcaption></figure>\n",
                     axis_ == 0 ? "y" : "x", axis_ == 0 ? "x" : "y", axis_ == 0 ? "y" : "x",
                     std::round(1e4 * f_.lowest_m[axis_ == 0 ? 1 : 0]) / 10 + 0.0,
                     scene_.goals
                         ? "; dashed and circles: the planned line, its entry, the target; "
                           "areas: forbidden zones"
                         : "");
  }

 private:
  static constexpr double kWidth = 560, kHeight = 480, kLeft = 58, kRight = 92, kTop = 14,
                          kBottom = 46;

  void include(const std::array<double, 3>& p_m) {
    const double u = p_m[static_cast<std::size_t>(axis_)];
    low_u_ = std::min(low_u_, u);
    high_u_ = std::max(high_u_, u);
    low_z_ = std::min(low_z_, p_m[2]);
    high_z_ = std::max(high_z_, p_m[2]);
  }
  double x(double u_m) const { return kLeft + (u_m - low_u_) * scale_; }
  double y(double z_m) const { return kTop + (high_z_ - z_m) * scale_; }

  std::string axes() const {
    std::string out;
    const double u_step = nice_step(1e3 * (high_u_ - low_u_), 6),
                 z_step = nice_step(1e3 * (high_z_ - low_z_), 8);
    for (const double at : ticks_of(1e3 * low_u_, 1e3 * high_u_, u_step))
      out += text_line(
          "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/><text "
          "class=\"mid\" x=\"%.1f\" y=\"%.1f\">%s</text>",
          x(at / 1e3), x(at / 1e3), kTop, kHeight - kBottom, x(at / 1e3), kHeight - kBottom + 17,
          number(at).c_str());
    for (const double at : ticks_of(1e3 * low_z_, 1e3 * high_z_, z_step))
      out += text_line(
          "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/><text "
          "class=\"end\" x=\"%.1f\" y=\"%.1f\">%s</text>",
          kLeft, kWidth - kRight, y(at / 1e3), y(at / 1e3), kLeft - 6, y(at / 1e3) + 4,
          number(at).c_str());
    out += text_line("<text class=\"mid\" x=\"%.1f\" y=\"%.1f\">%s (mm)</text>",
                     (kLeft + kWidth - kRight) / 2, kHeight - 8, axis_ == 0 ? "x" : "y");
    return out + text_line(
                     "<text class=\"mid\" transform=\"translate(14 %.1f) rotate(-90)\">height z "
                     "(mm)</text>\n",
                     kHeight / 2);
  }
  std::string layers() const {
    std::string out;
    for (const SceneLayer& layer : scene_.layers)
      out +=
          text_line("<rect class=\"layer\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>",
                    kLeft, y(layer.top_z_m), kWidth - kLeft - kRight, layer.thickness_m * scale_);
    return out;
  }
  std::string sheets() const {
    std::string out;
    for (std::size_t i = 0; i < facts_.sheets.size(); ++i) {
      const double at = y(facts_.sheets[i].z_m);
      out += text_line("<line class=\"sheet\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>",
                       kLeft, kWidth - kRight, at, at);
      const auto& material = facts_.material_m[static_cast<std::size_t>(axis_)];
      if (i >= material.size()) continue;
      for (const std::array<double, 2>& part : material[i]) {
        if (part[1] < low_u_ || part[0] > high_u_) continue;
        out += text_line("<line class=\"bone\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\"/>",
                         x(std::max(part[0], low_u_)), x(std::min(part[1], high_u_)), at, at);
      }
    }
    return out + '\n';
  }
  std::string zones() const {
    std::string out;
    bool at_top = false;
    if (!scene_.goals) return out;
    const auto a = static_cast<std::size_t>(axis_);
    for (const ForbiddenZone& zone : scene_.goals->zones) {
      double from = zone.low_m[a], to = zone.high_m[a], low = zone.low_m[2], high = zone.high_m[2];
      if (zone.shape == ForbiddenZone::Shape::kCapsule) {
        out += text_line(
            "<line class=\"zone\" stroke-opacity=\".3\" stroke-linecap=\"round\" x1=\"%.1f\" "
            "y1=\"%.1f\" x2=\"%.2f\" y2=\"%.1f\" stroke-width=\"%.1f\"/>",
            x(from), y(low), x(to) + 0.01, y(high), 2 * zone.radius_m * scale_);
        from = std::min(zone.low_m[a], zone.high_m[a]) - zone.radius_m;
        to = std::max(zone.low_m[a], zone.high_m[a]) + zone.radius_m;
        const double lower = std::min(low, high) - zone.radius_m;
        high = std::max(low, high) + zone.radius_m;
        low = lower;
      } else {
        if (zone.shape == ForbiddenZone::Shape::kPrism) {
          from = std::numeric_limits<double>::infinity();
          to = -from;
          for (const std::array<double, 2>& corner : zone.outline_m) {
            from = std::min(from, corner[a]);
            to = std::max(to, corner[a]);
          }
          low = zone.z_m[0];
          high = zone.z_m[1];
        }
        out +=
            text_line("<rect class=\"zone\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>",
                      x(from), y(high), (to - from) * scale_, (high - low) * scale_);
      }
      at_top = !at_top;  // labels of neighbours are apart
      const double seen_from = std::max(from, low_u_), seen_to = std::min(to, high_u_);
      if (seen_from < seen_to)
        out +=
            text_line(
                "<text class=\"mid zonetext\" x=\"%.1f\" y=\"%.1f\">", x((seen_from + seen_to) / 2),
                std::clamp(at_top ? y(high) + 16 : y(low) - 5, kTop + 16, kHeight - kBottom - 6)) +
            html_text(zone.name) + "</text>";
    }
    return out + '\n';
  }
  std::string plan() const {
    std::string out;
    if (!scene_.goals) return out;
    const auto a = static_cast<std::size_t>(axis_);
    if (const auto& line = scene_.goals->line) {
      constexpr double kFar_m = 1;
      const auto& d = line->direction;
      out += text_line("<line class=\"plan\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>",
                       x(line->entry_m[a]), y(line->entry_m[2]),
                       x(line->entry_m[a] + kFar_m * d[a]), y(line->entry_m[2] + kFar_m * d[2]));
      out += text_line("<circle class=\"aim\" cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>",
                       x(line->entry_m[a]), y(line->entry_m[2]),
                       line->entry_radius_m ? *line->entry_radius_m * scale_ : 4.0);
    }
    if (const auto& target = scene_.goals->target)
      out += text_line("<circle class=\"aim\" cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>",
                       x(target->at_m[a]), y(target->at_m[2]), target->radius_m * scale_);
    return out;
  }
  std::string path() const {
    std::string points, out;
    for (const ReportSample& s : f_.samples)
      points += text_line("%.1f,%.1f ", x(s.tip_m[static_cast<std::size_t>(axis_)]), y(s.tip_m[2]));
    out = "<polyline class=\"path\" points=\"" + points + "\"/>\n";
    for (const ReportPuncture& p : f_.punctures) {
      const auto near = std::min_element(f_.samples.begin(), f_.samples.end(),
                                         [&](const ReportSample& l, const ReportSample& r) {
                                           return std::abs(l.t_s - p.t_s) < std::abs(r.t_s - p.t_s);
                                         });
      if (near != f_.samples.end())
        out += text_line("<circle class=\"mark\" cx=\"%.1f\" cy=\"%.1f\" r=\"3.5\"/>",
                         x(near->tip_m[static_cast<std::size_t>(axis_)]), y(p.tip_z_m));
    }
    return out;
  }
  /// Names of sheets and layers at the right, none over another.
  std::string labels() const {
    std::string out;
    double last = -1e9;
    for (const SceneLayer& layer : scene_.layers) {
      const double at = std::max(y(layer.top_z_m - layer.thickness_m / 2) + 4, last + 14);
      out += text_line("<text class=\"soft\" x=\"%.1f\" y=\"%.1f\">", kWidth - kRight + 6, at) +
             html_text(layer.name.substr(0, 12)) + "</text>";
      last = at;
    }
    for (const ReportSheet& sheet : facts_.sheets) {
      const double at = y(sheet.z_m) + 4;
      if (at < last + 14) continue;
      out += text_line("<text class=\"soft\" x=\"%.1f\" y=\"%.1f\">slice %d</text>",
                       kWidth - kRight + 6, at, sheet.slice);
      last = at;
    }
    return out;
  }

  const Scene& scene_;
  const SessionFigures& f_;
  const ReportFacts& facts_;
  int axis_;
  double scale_ = 1;
  double low_u_ = std::numeric_limits<double>::infinity(), high_u_ = -low_u_, low_z_ = low_u_,
         high_z_ = high_u_;
};

std::string tile(const std::string& value, const std::string& name) {
  return "<div class=\"tile\"><b>" + html_text(value) + "</b><span>" + html_text(name) +
         "</span></div>\n";
}

std::string tiles(const SessionFigures& f) {
  const auto met =
      std::count_if(f.goals.begin(), f.goals.end(), [](const GoalResult& g) { return g.met; });
  std::string out = "<div class=\"tiles\">\n";
  if (!f.goals.empty())
    out += tile(text_line("%d of %zu", static_cast<int>(met), f.goals.size()), "goals met");
  out += tile(text_line("%.2f N", f.force_max_N), "largest force");
  out += tile(std::to_string(f.punctures_count), "punctures");
  out += tile(in_mm(f.plunge_max_m), "largest plunge");
  out += tile(in_s(static_cast<double>(f.ticks) / f.rate_Hz), "duration");
  out += tile(in_s(static_cast<double>(f.contact) / f.rate_Hz), "in contact");
  return out + tile(std::to_string(f.faults_count), "faults") + "</div>\n";
}

std::string goals_part(const SessionFigures& f) {
  if (f.goals.empty())
    return "<section><h2>Goals</h2><p>The scene states no goals.</p></section>\n";
  Table table({"result", "goal", "#measured", "#limit", "how it is computed"});
  for (const GoalResult& g : f.goals)
    table.row({g.met ? "met" : "not met", g.goal + (g.zone.empty() ? "" : ": " + g.zone),
               g.value ? with_unit(*g.value, g.unit) : "none",
               (g.at_least ? "at least " : "at most ") + with_unit(g.limit, g.unit), g.how},
              g.met ? "met" : "miss");
  return "<section><h2>Goals</h2>\n" + table.text() +
         "<p class=\"soft\">Each goal stands for itself; there is no overall mark. Without a "
         "measured value a goal is not met.</p></section>\n";
}

std::string not_listed(std::uint64_t count, std::size_t listed) {
  return count > listed ? text_line("<p class=\"soft\">%llu more are not listed.</p>\n",
                                    static_cast<unsigned long long>(count - listed))
                        : "";
}

std::string punctures_part(const Scene& scene, const SessionFigures& f, const ReportFacts& facts) {
  std::string out = "<section><h2>Punctures</h2>\n";
  if (f.punctures.empty()) return out + "<p>None.</p></section>\n";
  Table table({"slice or layer", "#time", "#force before", "#depth", "#height of the tip"});
  for (const ReportPuncture& p : f.punctures)
    table.row({name_of(scene, facts, p.what), in_s(p.t_s), text_line("%.2f N", p.force_N),
               in_mm(p.depth_m), in_mm(p.tip_z_m)});
  return out + table.text() + not_listed(f.punctures_count, f.punctures.size()) + "</section>\n";
}

std::string plunges_part(const Scene& scene, const SessionFigures& f, const ReportFacts& facts) {
  std::string out = "<section><h2>Plunge after a break-through</h2>\n";
  if (f.break_throughs.empty()) return out + "<p>No break-through.</p></section>\n";
  constexpr std::array<const char*, 6> kEnds = {
      "it came back",           "it stopped",      "the watched time was over",
      "the next break-through", "torques stopped", "the session ended"};
  Table table({"slice or layer", "#time", "#plunge", "#tip below it", "#after", "ended as"});
  for (const BreakThrough& b : f.break_throughs)
    table.row({name_of(scene, facts, b.what), in_s(b.t_s), in_mm(b.plunge_m), in_mm(b.below_m),
               in_s(b.lowest_t_s - b.t_s), kEnds[static_cast<std::size_t>(b.ended_by)]});
  return out + table.text() + not_listed(f.break_throughs_count, f.break_throughs.size()) +
         text_line(
             "<p class=\"soft\">A puncture at which the force falls to at most half. The plunge "
             "is the tip's way down from there until it comes back by %.2f mm, advances by "
             "less than that in %.2f s, or %.1f s are over.</p></section>\n",
             1e3 * kPlungeStep_m, kPlungeStop_s, kPlunge_s);
}

std::string times_part(const SessionFigures& f) {
  const auto seconds = [&](std::uint64_t ticks) {
    return in_s(static_cast<double>(ticks) / f.rate_Hz);
  };
  Table table({"time", "#value"});
  table.row({"whole session", seconds(f.ticks)});
  table.row({"free, above every slice", seconds(f.free)});
  table.row({"in contact", seconds(f.contact)});
  table.row({"through or beside slices, nothing bearing", seconds(f.through)});
  table.row({"stopped by a fault, or not started", seconds(f.ticks - f.counted)});
  table.row({"first contact at", f.first_contact_s ? in_s(*f.first_contact_s) : "none"});
  table.row({"from the first contact to the last puncture",
             f.first_contact_s && f.last_puncture_s ? in_s(*f.last_puncture_s - *f.first_contact_s)
                                                    : "none"});
  Table path({"path and force", "#value"});
  path.row({"way of the tip", in_mm(f.length_m)});
  path.row({"way from the first contact to the lowest place after it", in_mm(f.insertion_m)});
  path.row({"distance between the two", in_mm(f.straight_m)});
  path.row({"straightness: distance over way",
            f.insertion_m && *f.insertion_m > 0 ? text_line("%.4f", *f.straight_m / *f.insertion_m)
                                                : "none"});
  path.row({"largest depth below the topmost slice or layer",
            f.counted > 0 ? in_mm(f.top_z_m - f.lowest_z_m) : "none"});
  path.row({"largest force", text_line("%.2f N at %.3f s", f.force_max_N, f.force_max_t_s)});
  path.row({"mean force in contact",
            f.contact > 0 ? text_line("%.2f N", f.contact_sum_N / static_cast<double>(f.contact))
                          : "none"});
  return "<section><h2>Times, path and force</h2><div class=\"pair\">" + table.text() +
         path.text() + "</div></section>\n";
}

std::string tremor_part(const SessionFigures& f) {
  Table table({"tremor of the tip", "#RMS", "#RMS sideways (x, y)", "#time counted"});
  const auto add = [&](const char* name, const Tremor& t) {
    const auto n = static_cast<double>(t.ticks);
    table.row({name, t.ticks > 0 ? text_line("%.4f mm", 1e3 * std::sqrt(t.squares_m2 / n)) : "none",
               t.ticks > 0 ? text_line("%.4f mm", 1e3 * std::sqrt(t.sideways_m2 / n)) : "none",
               in_s(n / f.rate_Hz)});
  };
  add("free", f.tremor_free);
  add("in contact", f.tremor_contact);
  return "<section><h2>Tremor</h2>\n" + table.text() +
         text_line(
             "<p class=\"soft\">The tip's place band-passed from %.0f to %.0f Hz: a high-pass, "
             "then "
             "a low-pass, both Butterworth of the second order, y = (b0 x + b1 x1 + b2 x2 - a1 y1 "
             "- "
             "a2 y2) / a0 with w = 2&pi;f / rate, &alpha; = sin w / &radic;2, a0 = 1 + &alpha;, a1 "
             "= -2 cos w, a2 = 1 - &alpha;; high-pass b0 = b2 = (1 + cos w) / 2, b1 = -(1 + cos "
             "w); "
             "low-pass b0 = b2 = (1 - cos w) / 2, b1 = 1 - cos w. x, y: place and result in a row, "
             "x1, y1 and x2, y2 those of the two rows before. RMS = &radic;(mean of |y|&sup2;) "
             "over "
             "the rows, without the first %.1f s after a start. What a puncture releases is in it, "
             "mostly along z.</p></section>\n",
             kTremorLow_Hz, kTremorHigh_Hz, kTremorSettle_s);
}

std::string plan_part(const Scene& scene, const SessionFigures& f) {
  if (!scene.goals) return "";
  std::string out;
  Table table({"plan", "#value"});
  const bool on_line = f.line_ticks > 0;
  if (scene.goals->line) {
    table.row({"distance to the planned line, largest", on_line ? in_mm(f.line_max_m) : "none"});
    table.row({"distance to the planned line, RMS",
               on_line ? in_mm(std::sqrt(f.line_squares_m2 / static_cast<double>(f.line_ticks)))
                       : "none"});
    table.row({"distance to it at the entry point", on_line ? in_mm(f.line_entry_m) : "none"});
  }
  if (scene.goals->target) {
    table.row({"smallest distance to the target",
               f.target_m ? in_mm(*f.target_m) + " at " + in_s(f.target_t_s) : "none"});
    table.row(
        {"target reached at", f.target_reached_s ? in_s(*f.target_reached_s) : "not reached"});
  }
  if (scene.goals->line || scene.goals->target)
    out += "<section><h2>Plan</h2>\n" + table.text() +
           "<p class=\"soft\">Of the tip's point, in rows where it is beyond the entry point along "
           "the line.</p></section>\n";
  if (scene.goals->zones.empty()) return out;
  Table zones(
      {"forbidden zone", "#smallest distance", "#at", "#breaches", "breaches: time and depth"});
  for (std::size_t i = 0; i < f.zones.size(); ++i) {
    const ZoneFigures& zone = f.zones[i];
    std::string spans;
    for (const Span& span : zone.breaches)
      spans += (spans.empty() ? "" : "; ") + text_line("%.3f to %.3f s, %.2f mm deep", span.from_s,
                                                       span.to_s, 1e3 * span.depth_m);
    if (zone.breaches_count > zone.breaches.size()) spans += "; more";
    zones.row({scene.goals->zones[i].name, in_mm(zone.min_m),
               zone.min_m ? in_s(zone.min_t_s) : "none", std::to_string(zone.breaches_count),
               spans.empty() ? "none" : spans});
  }
  return out + "<section><h2>Forbidden zones</h2>\n" + zones.text() +
         "<p class=\"soft\">Of the tip's point; negative: inside. The tool's thickness is not "
         "counted: a zone's margin is for it.</p></section>\n";
}

std::string walls_part(const SessionFigures& f) {
  std::string out = "<section><h2>Walls</h2>\n";
  if (f.beside_count == 0 && f.side_cuts_count == 0)
    return out +
           "<p>The tool did not leave a slice's outline, and cut no wall sideways.</p></section>\n";
  Table table({"what", "slice", "#from", "#to"});
  for (const Span& span : f.beside)
    table.row({"beside the material", span.slice < 0 ? "none" : std::to_string(span.slice),
               in_s(span.from_s), in_s(span.to_s)});
  for (const Span& span : f.side_cuts)
    table.row({"wall cut sideways", std::to_string(span.slice), in_s(span.from_s), ""});
  return out + table.text() + not_listed(f.beside_count, f.beside.size()) +
         not_listed(f.side_cuts_count, f.side_cuts.size()) + "</section>\n";
}

std::string faults_part(const SessionFigures& f, const ReportFacts& facts) {
  std::string out = "<section><h2>Faults</h2>\n";
  if (f.faults.empty()) return out + "<p>None.</p></section>\n";
  Table table({"fault", "#at", "#forces again at", "what it means and what to do"});
  for (const ReportFault& fault : f.faults)
    table.row({words_of(fault.fault).name, in_s(fault.t_s),
               fault.recovered_s ? in_s(*fault.recovered_s) : "not", fault_message(fault, facts)},
              "miss");
  return out + table.text() + not_listed(f.faults_count, f.faults.size()) + "</section>\n";
}

}  // namespace

std::string session_report_page(const Scene& scene, const SessionFigures& f,
                                const ReportFacts& facts) {
  const std::string title = "Session report: " + scene.name;
  const char* end = facts.end == SessionEnd::kDone          ? "ran to its end"
                    : facts.end == SessionEnd::kInterrupted ? "was interrupted"
                                                            : "was stopped by a fault";
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
      "<meta name=\"viewport\" content=\"width=device-width\">"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src "
      "'unsafe-inline'\"><title>" +
      html_text(title) + "</title><style>" + kStyle + "</style></head><body>\n<h1>" +
      html_text(scene.name) + "</h1>\n<p class=\"soft\">" +
      html_text(text_line(
          "Session report. Asset %s, force law %s, %llu ticks at %.6g Hz (%s clock); "
          "the session %s. For training, not for planning.",
          facts.asset.c_str(), facts.force_law.c_str(), static_cast<unsigned long long>(f.ticks),
          f.rate_Hz, facts.is_virtual ? "virtual" : "real", end)) +
      "</p>\n";
  if (facts.lost_ticks > 0)
    out += text_line("<p class=\"miss\">%llu ticks are missing: the machine was too slow.</p>\n",
                     static_cast<unsigned long long>(facts.lost_ticks));
  out += tiles(f) + goals_part(f);
  if (!f.samples.empty())
    out += "<section><h2>Path of the tip</h2><div class=\"pair\">" +
           SideView(scene, f, facts, 0).draw() + SideView(scene, f, facts, 1).draw() +
           "</div></section>\n<section><h2>Force</h2><div class=\"pair\">" +
           force_plot(scene, f, false) + force_plot(scene, f, true) + "</div></section>\n";
  out += punctures_part(scene, f, facts) + plunges_part(scene, f, facts) + plan_part(scene, f) +
         walls_part(f) + faults_part(f, facts) + times_part(f) + tremor_part(f);
  return out +
         "<p class=\"soft\">Places are in the device's frame: z up, origin in its base. Heights "
         "and "
         "depths are of the tool's tip. The force is what the motors delivered to the hand. Rows "
         "count while the device is ready or running. trocar-run " TROCAR_VERSION
         ".</p>\n</body></html>\n";
}

}  // namespace trocar::runtime
