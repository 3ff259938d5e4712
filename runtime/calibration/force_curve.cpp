// SPDX-License-Identifier: Apache-2.0
#include "runtime/calibration/force_curve.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <optional>

#include "formats/base/file_io.h"
#include "formats/base/text_line.h"

namespace trocar::runtime {
namespace {

enum Column : std::uint8_t { kDepth, kForce, kSpeed, kTime, kColumns };
constexpr std::array<std::string_view, kColumns> kNames{"depth_mm", "force_N", "speed_mm_per_s",
                                                        "time_s"};
constexpr std::array<double, kColumns> kMost{1e6, kMaxCurveForce_N, 1e6, 1e9};
/// A withdrawal moves back by at least this part of the insertion's travel.
constexpr double kMinWithdrawal = 0.1;
/// Depth may go back by this part of the travel, because encoders are noisy.
constexpr double kMaxBackstep = 0.02;

std::string_view trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\r'; };
  while (!text.empty() && is_blank(text.front()))
    text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back()))
    text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> fields_of(std::string_view line, char separator) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t end = line.find(separator);
    fields.push_back(trimmed(line.substr(0, end)));
    // A hostile line must not become millions of fields.
    if (end == std::string_view::npos || fields.size() > kColumns) return fields;
    line.remove_prefix(end + 1);
  }
}

struct Header {
  char separator = ',';
  std::vector<Column> columns;
};

Result<Header> parse_header(std::string_view line) {
  Header header;
  if (line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
  for (const char separator : {';', '\t'})
    if (line.find(separator) != std::string_view::npos) header.separator = separator;
  std::array<bool, kColumns> has{};
  constexpr const char* kHelp =
      "the first line must name the columns depth_mm and force_N, and may name speed_mm_per_s and "
      "time_s";
  for (const std::string_view field : fields_of(line, header.separator)) {
    const auto* const found = std::find(kNames.begin(), kNames.end(), field);
    if (found == kNames.end()) return refused(kHelp);
    const auto column = static_cast<Column>(found - kNames.begin());
    if (has.at(column)) return refused("the column " + std::string(field) + " occurs twice");
    has.at(column) = true;
    header.columns.push_back(column);
  }
  if (!has[kDepth] || !has[kForce]) return refused(kHelp);
  return header;
}

using CurveRow = std::array<double, kColumns>;

Result<CurveRow> parse_row(std::string_view line, const Header& header) {
  const std::vector<std::string_view> fields = fields_of(line, header.separator);
  if (fields.size() != header.columns.size())
    return refused(text_line("must have %zu fields", header.columns.size()));
  CurveRow row{};
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const Column column = header.columns[i];
    const std::string name(kNames.at(column));
    std::string_view text = fields[i];
    if (text.starts_with('+')) text.remove_prefix(1);
    double& value = row.at(column);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size())
      return refused(name + " is not a number");
    if (!std::isfinite(value)) return refused(name + " is not finite");
    if (std::abs(value) > kMost.at(column))
      return refused(text_line("%s is beyond %g", name.c_str(), kMost.at(column)));
  }
  return row;
}

Result<std::vector<CurveRow>> parse_rows(std::string_view csv, std::optional<Header>& header) {
  std::vector<CurveRow> rows;
  for (std::size_t number = 1; !csv.empty(); ++number) {
    const std::size_t end = std::min(csv.find('\n'), csv.size());
    const std::string_view line = csv.substr(0, end);
    csv.remove_prefix(std::min(end + 1, csv.size()));
    if (trimmed(line).empty() && header) continue;
    const std::string where = text_line("line %zu: ", number);
    if (!header) {
      Result<Header> parsed = parse_header(line);
      if (!parsed) return refused(where + parsed.error().message);
      header = std::move(*parsed);
      continue;
    }
    const Result<CurveRow> row = parse_row(line, *header);
    if (!row) return refused(where + row.error().message);
    if (rows.size() >= kMaxCurveRows)
      return refused(text_line("has more than %zu rows", kMaxCurveRows));
    rows.push_back(*row);
  }
  return rows;
}

/// Checks that the depth moves one way; `sign` is 1 for an insertion and -1 for a withdrawal.
bool is_one_way(const std::vector<CurvePoint>& points, double sign, double max_back_mm) {
  double farthest = -HUGE_VAL;
  for (const CurvePoint& point : points) {
    if (sign * point.depth_mm < farthest - max_back_mm) return false;
    farthest = std::max(farthest, sign * point.depth_mm);
  }
  return true;
}

std::optional<std::string> wrong_travel(double travel_mm) {
  if (!(travel_mm > 0)) return "depth_mm never grows; it must grow while the tool moves in";
  if (travel_mm < kMinTravel_mm)
    return text_line(
        "depth_mm grows by %.4g only, and must grow by at least %g mm; is it in metres?", travel_mm,
        kMinTravel_mm);
  if (travel_mm > kMaxTravel_mm)
    return text_line("depth_mm grows by %.4g, and must not grow by more than %g mm; is it in um?",
                     travel_mm, kMaxTravel_mm);
  return std::nullopt;
}

void set_speeds(const std::vector<CurveRow>& rows, std::size_t deepest, ForceCurve& curve) {
  std::vector<double> speeds;
  for (std::size_t i = 0; i <= deepest; ++i)
    speeds.push_back(std::abs(rows[i][kSpeed]));
  std::sort(speeds.begin(), speeds.end());
  curve.low_speed_mm_per_s = speeds[speeds.size() / 20];
  curve.high_speed_mm_per_s = speeds[speeds.size() - 1 - speeds.size() / 20];
}

Result<ForceCurve> curve_of(const std::vector<CurveRow>& rows, bool has_speed) {
  if (rows.empty()) return refused("has no row of numbers");
  const auto deepest = static_cast<std::size_t>(
      std::max_element(rows.begin(), rows.end(),
                       [](const CurveRow& a, const CurveRow& b) { return a[kDepth] < b[kDepth]; }) -
      rows.begin());
  ForceCurve curve;
  double low_N = HUGE_VAL, high_N = -HUGE_VAL, top_mm = HUGE_VAL, last_mm = HUGE_VAL;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    (i <= deepest ? curve.insertion : curve.withdrawal)
        .push_back({rows[i][kDepth], rows[i][kForce]});
    if (i > deepest) {
      last_mm = std::min(last_mm, rows[i][kDepth]);
      continue;
    }
    low_N = std::min(low_N, rows[i][kForce]);
    high_N = std::max(high_N, rows[i][kForce]);
    top_mm = std::min(top_mm, rows[i][kDepth]);
  }
  const double travel_mm = rows[deepest][kDepth] - top_mm;
  if (rows.size() < kMinCurveRows)
    return refused(
        text_line("has %zu rows, and must have at least %zu", rows.size(), kMinCurveRows));
  if (const auto wrong = wrong_travel(travel_mm)) return refused(*wrong);
  if (curve.insertion.size() < kMinCurveRows)
    return refused(text_line("has %zu rows before the deepest point, and must have at least %zu",
                             curve.insertion.size(), kMinCurveRows));
  if (!(high_N > low_N)) return refused(text_line("force_N is %g in all rows", low_N));
  const double back_mm = std::max(kMaxBackstep * travel_mm, 0.02);
  constexpr const char* kBackAndForth =
      "depth_mm goes back and forth; a curve has one insertion and at most one withdrawal";
  if (!is_one_way(curve.insertion, 1, back_mm)) return refused(kBackAndForth);
  if (rows[deepest][kDepth] - last_mm < kMinWithdrawal * travel_mm)
    curve.withdrawal.clear();  // the machine came to rest
  if (!is_one_way(curve.withdrawal, -1, back_mm)) return refused(kBackAndForth);
  if (has_speed) set_speeds(rows, deepest, curve);
  return curve;
}

}  // namespace

Result<ForceCurve> parse_force_curve(std::string_view csv, const std::string& name) {
  if (csv.size() > kMaxCurveBytes)
    return refused(name + text_line(": is larger than %zu bytes", kMaxCurveBytes));
  std::optional<Header> header;
  const Result<std::vector<CurveRow>> rows = parse_rows(csv, header);
  if (!rows) return refused(name + ": " + rows.error().message);
  if (!header) return refused(name + ": is empty");
  const bool has_speed =
      std::find(header->columns.begin(), header->columns.end(), kSpeed) != header->columns.end();
  Result<ForceCurve> curve = curve_of(*rows, has_speed);
  if (!curve) return refused(name + ": " + curve.error().message);
  return curve;
}

Result<ForceCurve> read_force_curve(const std::filesystem::path& file) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file, kMaxCurveBytes);
  if (!bytes) return bytes.error();
  return parse_force_curve(
      std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()), file.string());
}

}  // namespace trocar::runtime
