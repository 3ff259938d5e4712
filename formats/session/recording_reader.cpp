// SPDX-License-Identifier: Apache-2.0
#include <charconv>
#include <cmath>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/session/recording.h"
#include "formats/session/recording_fields.h"

namespace trocar {
namespace {

/// Reads the fields of one row (visit_fields()) and keeps the first error.
class RowReader {
 public:
  explicit RowReader(std::string_view line) : rest_(line) {}

  bool ok() const { return why_ == nullptr; }
  bool is_at_end() const { return ended_; }
  const char* why() const { return why_; }
  std::size_t field() const { return field_; }  ///< number of fields read so far

  template <typename Number>
  void number(Number& x) {
    const std::string_view text = next();
    if (!ok()) return;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
    if (error != std::errc() || end != text.data() + text.size()) why_ = "is not a number";
  }
  /// The origin is in the first row. In other rows the field must be empty.
  void origin(bool first_row, RecordingOrigin& origin) {
    const std::string_view text = next();
    if (!ok()) return;
    if (!first_row && !text.empty()) {
      why_ = "belongs to the first row only";
      return;
    }
    if (!first_row) return;
    Result<RecordingOrigin> parsed = parse_origin(text);
    if (parsed) origin = std::move(*parsed);
    if (!parsed) why_ = "is not KEY=VALUE;KEY=VALUE";
  }
  void flag(std::uint8_t& x) {
    number(x);
    if (ok() && x > 1) why_ = "is neither 0 nor 1";
  }
  void bits(std::uint8_t& x, unsigned all) {
    number(x);
    if (ok() && (x & ~all) != 0) why_ = "is an unknown number";
  }
  void finite(double& x) {
    number(x);
    if (ok() && !std::isfinite(x)) why_ = "is not finite";
  }
  template <std::size_t N>
  void finite(std::array<double, N>& numbers) {
    for (double& x : numbers)
      finite(x);
  }
  template <typename Enum, std::size_t N>
  void name(Enum& value, const std::array<const char*, N>& names) {
    const std::string_view text = next();
    if (!ok()) return;
    for (std::size_t i = 0; i < N; ++i) {
      if (text == names[i]) {
        value = static_cast<Enum>(i);
        return;
      }
    }
    why_ = "is an unknown name";
  }

 private:
  std::string_view next() {
    if (!ok()) return {};
    ++field_;
    if (ended_) {
      why_ = "is missing";
      return {};
    }
    const std::size_t comma = rest_.find(',');
    const std::string_view text = rest_.substr(0, comma);
    ended_ = comma == std::string_view::npos;
    rest_.remove_prefix(ended_ ? rest_.size() : comma + 1);
    return text;
  }

  std::string_view rest_;
  std::size_t field_ = 0;
  bool ended_ = false;
  const char* why_ = nullptr;
};

/// Reads the row that follows `before` (null for the first row). The message of an error does not
/// contain the line number.
Result<RecordingRow> parse_row(std::string_view line, const RecordingKind& kind,
                               const RecordingRow* before, RecordingOrigin& origin) {
  RecordingRow row;
  RowReader reader(line);
  visit_fields(row, kind, reader);
  reader.origin(before == nullptr, origin);
  if (!reader.ok())
    return refused(recording_columns(kind).at(reader.field() - 1) + " " + reader.why());
  if (!reader.is_at_end()) return refused("has too many fields");
  if (before != nullptr && !(row.t_s > before->t_s))
    return refused("t_s is not later than in the row before");
  return row;
}

}  // namespace

Result<std::vector<RecordingRow>> parse_recording(std::string_view csv, const std::string& name,
                                                  RecordingOrigin* origin, bool* is_cut) {
  if (is_cut != nullptr) {
    *is_cut = !csv.empty() && csv.back() != '\n';
    csv = csv.substr(0, csv.rfind('\n') + 1);  // npos + 1 is 0
  }
  std::vector<RecordingRow> rows;
  RecordingOrigin found;
  std::optional<RecordingKind> kind;
  for (std::size_t line_number = 1; !csv.empty(); ++line_number) {
    const std::size_t end = csv.find('\n');
    const std::string where = name + ": line " + std::to_string(line_number) + ": ";
    if (end == std::string_view::npos) return refused(where + "has no line feed at its end");
    const std::string_view line = csv.substr(0, end);
    csv.remove_prefix(end + 1);
    if (line_number == 1) {
      kind = kind_of_header(line);
      if (!kind) return refused(where + "is not the header of a recording");
      continue;
    }
    const auto row = parse_row(line, *kind, rows.empty() ? nullptr : &rows.back(), found);
    if (!row) return refused(where + row.error().message);
    rows.push_back(*row);
  }
  if (rows.empty()) return refused(name + ": has no row");
  if (origin != nullptr) *origin = std::move(found);
  return rows;
}

Result<std::vector<RecordingRow>> read_recording(const std::filesystem::path& file,
                                                 RecordingOrigin* origin, bool* is_cut) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file, kMaxRecordingBytes);
  if (!bytes) return bytes.error();
  return parse_recording(
      std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()), file.string(),
      origin, is_cut);
}

}  // namespace trocar
