// SPDX-License-Identifier: Apache-2.0
#include "formats/session/recording.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <sstream>

#include "formats/base/text.h"
#include "formats/session/faults.h"

namespace trocar {
namespace {

constexpr std::array<const char*, 5> kPhaseNames = {"free", "contact", "punctured", "beside",
                                                    "fault"};
constexpr std::array<const char*, kSafetyStates> kSafetyNames = {"idle", "ready", "running",
                                                                 "fault", "recovering"};
constexpr std::array<const char*, kRecordedDeviceStatuses> kDeviceStatusNames = {
    "ok", "no_data", "link_lost", "emergency_stop", "motor_fault"};

const std::array<const char*, kFaults>& fault_names() {
  static const auto names = [] {
    std::array<const char*, kFaults> made{};
    for (std::size_t i = 0; i < made.size(); ++i)
      made[i] = words_of(static_cast<Fault>(i)).name;
    return made;
  }();
  return names;
}

/// Names of one or more columns, separated by commas.
using Columns = const char*;

/// The columns of a recording and the fields of its rows, in order, for header, writing and reading.
/// Calls a member of the visitor for each field except the origin: number() gets any number or
/// numbers; finite() gets such that must not be infinite or nan; flag() gets 0 or 1; bits() gets an
/// integer and the bits that may be set in it; name() gets an enumerator and the list of names.
template <typename Row, typename Visitor>
void visit_fields(Row& row, const RecordingKind& kind, Visitor& visitor) {
  visitor.finite("t_s", row.t_s);
  visitor.finite("x_m,y_m,z_m", row.p_m);
  visitor.finite("qw,qx,qy,qz", row.q);
  visitor.finite("tool_x_m,tool_y_m,tool_z_m", row.tool_m);
  visitor.finite("fx_wanted_N,fy_wanted_N,fz_wanted_N,tx_wanted_Nm,ty_wanted_Nm,tz_wanted_Nm",
                 row.wrench_wanted);
  visitor.finite(
      "fx_delivered_N,fy_delivered_N,fz_delivered_N,tx_delivered_Nm,ty_delivered_Nm,tz_delivered_"
      "Nm",
      row.wrench_delivered);
  if (kind.has_pose_device) {
    visitor.number("device_x_m,device_y_m,device_z_m", row.pose_device.p_m);
    visitor.number("device_qw,device_qx,device_qy,device_qz", row.pose_device.q);
    visitor.number("buttons", row.pose_device.buttons);
    visitor.finite("fx_device_N,fy_device_N,fz_device_N,tx_device_Nm,ty_device_Nm,tz_device_Nm",
                   row.pose_device.wrench);
  } else {
    visitor.finite(
        "tau_1_1_Nm,tau_1_4_Nm,tau_2_1_Nm,tau_2_4_Nm,tau_3_1_Nm,tau_3_4_Nm,tau_4_1_Nm,tau_4_4_Nm",
        row.tau_Nm);
    visitor.number(
        "th_1_1_rad,th_1_2_rad,th_1_3_rad,th_1_4_rad,th_2_1_rad,th_2_2_rad,th_2_3_rad,th_2_4_rad,"
        "th_3_1_rad,th_3_2_rad,th_3_3_rad,th_3_4_rad,th_4_1_rad,th_4_2_rad,th_4_3_rad,th_4_4_rad",
        row.encoder_rad);
  }
  visitor.name("state", row.phase, kPhaseNames);
  visitor.number("active_slice", row.active_slice);
  visitor.finite("penetration_m", row.penetration_m);
  visitor.finite("wrench_scale", row.wrench_scale);
  visitor.finite("pose_residual_m", row.pose_residual_m);
  visitor.number("cuts_published", row.cuts_published);
  visitor.number("response_sheet", row.response_sheet);
  visitor.number("response_stiffness_N_per_m", row.response_stiffness_N_per_m);
  visitor.number("response_x_m,response_y_m", row.response_offset_m);
  visitor.name("fault", row.fault, fault_names());
  visitor.name("device_read", row.device_read, kDeviceStatusNames);
  visitor.finite("state_t_s", row.state_t_s);
  visitor.name("device_write", row.device_write, kDeviceStatusNames);
  visitor.name("outside_fault", row.outside_fault, fault_names());
  visitor.flag("recovery_asked", row.recovery_asked);
  visitor.name("safety", row.safety, kSafetyNames);
  visitor.finite("authority", row.authority);
  visitor.finite("passivity_J", row.passivity_J);
  visitor.finite("passivity_N_s_per_m", row.passivity_N_s_per_m);
  if (kind.has_guard) visitor.finite("guard", row.guard);
  visitor.finite("motor_heat_max", row.motor_heat_max);
  if (kind.has_xray) visitor.bits("xray", row.xray, kXrayPicture | kXrayBeam);
  if (kind.has_cutting) {
    auto& cutting = row.cutting;
    visitor.finite("fx_tissue_N,fy_tissue_N,fz_tissue_N,tx_tissue_Nm,ty_tissue_Nm,tz_tissue_Nm",
                   cutting.wrench_tissue);
    visitor.finite("front_z_m", cutting.front_z_m);
    visitor.finite("front_HU", cutting.front_HU);
    visitor.finite("tip_N", row.tip_N);
    visitor.finite("embedded_m", cutting.embedded_m);
    visitor.finite("cut_J", cutting.cut_J);
    visitor.finite("absorbed_J", cutting.absorbed_J);
    visitor.finite("tissue_stored_J", cutting.stored_J);
    visitor.number("steps", cutting.steps);
  } else {
    visitor.finite("tip_N", row.tip_N);
  }
  visitor.finite("break_through_N", row.break_through_N);
  visitor.number("break_through_at", row.break_through_at);
}

/// Joins the names of the columns, each followed by a comma.
struct HeaderWriter {
  std::string header;
  void number(Columns columns, const auto& /*x*/) { header.append(columns).push_back(','); }
  void finite(Columns columns, const auto& x) { number(columns, x); }
  void flag(Columns columns, const auto& x) { number(columns, x); }
  void bits(Columns columns, const auto& x, unsigned /*all*/) { number(columns, x); }
  void name(Columns columns, const auto& x, const auto& /*names*/) { number(columns, x); }
};

/// The kind of recording that has this header line, if any.
std::optional<RecordingKind> kind_of_header(std::string_view header) {
  for (unsigned bits = 0; bits < 16; ++bits) {
    const RecordingKind kind{(bits & 1) != 0, (bits & 2) != 0, (bits & 4) != 0, (bits & 8) != 0};
    if (header == recording_header(kind)) return kind;
  }
  return std::nullopt;
}

/// Name of a column, counted from 0.
std::string column_name(const RecordingKind& kind, std::size_t column) {
  std::istringstream names(recording_header(kind));
  std::string name;
  for (std::size_t i = 0; i <= column; ++i)
    std::getline(names, name, ',');
  return name;
}

constexpr std::size_t kMaxCharacters = 4096;
constexpr std::string_view kCharacters =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._+-/";

bool is_word(std::string_view text) {
  return !text.empty() && text.find_first_not_of(kCharacters) == std::string_view::npos;
}

bool names_file(std::string_view key) {
  return key == kOriginScene || key == kOriginAsset || key == kOriginDevice;
}

/// The first digits of a digest, enough for a person to compare.
std::string shown(const std::string* value) {
  constexpr std::size_t kDigest = 64, kDigits = 12;
  if (value == nullptr) return "not stated";
  return value->size() == kDigest ? value->substr(0, kDigits) + "..." : *value;
}

/// Reads the fields of one row (visit_fields()) and keeps the first error.
class RowReader {
 public:
  explicit RowReader(std::string_view line) : rest_(line) {}

  bool ok() const { return why_ == nullptr; }
  bool is_at_end() const { return ended_; }
  const char* why() const { return why_; }
  std::size_t field() const { return field_; }  ///< number of fields read so far

  template <typename Number>
  void number(Columns /*columns*/, Number& x) {
    const std::string_view text = next();
    if (!ok()) return;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
    if (error != std::errc() || end != text.data() + text.size()) why_ = "is not a number";
  }
  template <typename Number, std::size_t N>
  void number(Columns columns, std::array<Number, N>& numbers) {
    for (Number& x : numbers)
      number(columns, x);
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
  void flag(Columns columns, std::uint8_t& x) {
    number(columns, x);
    if (ok() && x > 1) why_ = "is neither 0 nor 1";
  }
  void bits(Columns columns, std::uint8_t& x, unsigned all) {
    number(columns, x);
    if (ok() && (x & ~all) != 0) why_ = "is an unknown number";
  }
  void finite(Columns columns, double& x) {
    number(columns, x);
    if (ok() && !std::isfinite(x)) why_ = "is not finite";
  }
  template <std::size_t N>
  void finite(Columns columns, std::array<double, N>& numbers) {
    for (double& x : numbers)
      finite(columns, x);
  }
  template <typename Enum, std::size_t N>
  void name(Columns /*columns*/, Enum& value, const std::array<const char*, N>& names) {
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
  if (!reader.ok()) return refused(column_name(kind, reader.field() - 1) + " " + reader.why());
  if (!reader.is_at_end()) return refused("has too many fields");
  if (before != nullptr && !(row.t_s > before->t_s))
    return refused("t_s is not later than in the row before");
  return row;
}

using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kFlushBytes = std::size_t{64} << 10;
constexpr mode_t kPrivate = 0600;

/// Appends each field of a row (visit_fields()), followed by a comma.
class RowWriter {
 public:
  explicit RowWriter(std::string& out) : out_(out) {}

  template <typename Number>
  void number(Columns /*columns*/, Number x) {
    std::array<char, 32> text;
    const auto end = std::to_chars(text.data(), text.data() + text.size(), x).ptr;
    out_.append(text.data(), end).push_back(',');
  }
  template <typename Number, std::size_t N>
  void number(Columns columns, const std::array<Number, N>& numbers) {
    for (const Number x : numbers)
      number(columns, x);
  }
  void finite(Columns columns, const auto& x) { number(columns, x); }
  void flag(Columns columns, std::uint8_t x) { number(columns, x); }
  void bits(Columns columns, std::uint8_t x, unsigned /*all*/) { number(columns, x); }
  void name(Columns /*columns*/, auto value, const auto& names) {
    out_.append(names.at(static_cast<std::size_t>(value))).push_back(',');
  }

 private:
  std::string& out_;
};

// Renames a file to a name that must be free. Returns false and sets errno on failure (EEXIST: the
// name is taken). link() would do that in one step, but not every file system has hard links.
bool rename_to_free(const std::string& from, const std::string& to) {
  const int placeholder = ::open(to.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, kPrivate);
  if (placeholder < 0) return false;
  ::close(placeholder);
  if (::rename(from.c_str(), to.c_str()) == 0) return true;
  const int error = errno;
  ::unlink(to.c_str());
  errno = error;
  return false;
}

// Locks a file that nobody writes. is_being_recorded() of another program holds a lock for a moment.
bool lock(int fd) {
  constexpr int kTimes = 20;
  constexpr useconds_t kWait_us = 1000;
  for (int i = 0; i < kTimes; ++i) {
    if (::flock(fd, LOCK_EX | LOCK_NB) == 0) return true;
    if (errno != EWOULDBLOCK) return false;
    ::usleep(kWait_us);
  }
  errno = EWOULDBLOCK;
  return false;
}

// Renames the file left by an interrupted recording to the first free name of partial.1, partial.2
// and so on. Returns false and sets errno on failure (EWOULDBLOCK: another program is writing it).
bool move_aside(const std::string& partial) {
  constexpr int kMaxKept = 10000;
  const int old = ::open(partial.c_str(), O_WRONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC);
  if (old < 0) return false;
  bool moved = false;
  if (lock(old)) {
    errno = EEXIST;
    for (int n = 1; n < kMaxKept && !moved && errno == EEXIST; ++n)
      moved = rename_to_free(partial, partial + "." + std::to_string(n));
  }
  const int error = errno;
  ::close(old);
  errno = error;
  return moved;
}

// Creates a file that is locked while it is open. Returns -1 and sets errno like move_aside().
int open_partial(const std::string& partial) {
  constexpr int kFlags = O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC;
  int fd = ::open(partial.c_str(), kFlags, kPrivate);
  if (fd < 0 && errno == EEXIST && move_aside(partial))
    fd = ::open(partial.c_str(), kFlags, kPrivate);
  if (fd >= 0) static_cast<void>(lock(fd));
  return fd;
}

}  // namespace

RecordingKind recording_kind(const RecordingOrigin& origin) {
  const std::string *const law = origin.find("force-law"), *const device =
                                                               origin.find(kOriginDeviceKind);
  return {.has_cutting = law != nullptr && *law == "cutting",
          .has_pose_device = device != nullptr && *device == kPoseDeviceKind,
          .has_xray = origin.find(kOriginXray) != nullptr,
          .has_guard = origin.find(kOriginEstimator) != nullptr};
}

const char* to_string(ContactPhase phase) {
  return kPhaseNames.at(static_cast<std::size_t>(phase));
}
const char* to_string(Fault fault) {
  return words_of(fault).name;
}
const char* to_string(SafetyState state) {
  return kSafetyNames.at(static_cast<std::size_t>(state));
}
const char* to_string(DeviceStatus status) {
  return kDeviceStatusNames.at(static_cast<std::size_t>(status));
}

std::string describe_break_through(std::int32_t at, double t_s, double resistance_N) {
  const std::string what = at >= 0 ? text_line("slice %d", at)
                           : at <= kBreakThroughLayer
                               ? text_line("soft layer %d", kBreakThroughLayer - at + 1)
                               : std::string("the tissue");
  return text_line("broke through %s at %.3f s: %.2f N at the tip before", what.c_str(), t_s,
                   resistance_N);
}

std::string recording_header(const RecordingKind& kind) {
  const RecordingRow row;
  HeaderWriter columns;
  visit_fields(row, kind, columns);
  return columns.header + "origin";  // text, in the first row only
}

const std::string* RecordingOrigin::find(std::string_view key) const {
  const auto found = std::find_if(entries.begin(), entries.end(),
                                  [&](const auto& entry) { return entry.first == key; });
  return found == entries.end() ? nullptr : &found->second;
}

std::optional<double> RecordingOrigin::number(std::string_view key) const {
  const std::string* const text = find(key);
  double number = 0;
  if (text == nullptr) return std::nullopt;
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), number);
  if (error != std::errc() || end != text->data() + text->size()) return std::nullopt;
  return number;
}

std::string origin_number(double x) {
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), x).ptr;
  return {text.data(), end};
}

std::string to_text(const RecordingOrigin& origin) {
  std::string text;
  for (const auto& [key, value] : origin.entries) {
    if (!text.empty()) text += ';';
    text.append(key).append("=").append(value);
  }
  return text;
}

Result<RecordingOrigin> parse_origin(std::string_view text) {
  RecordingOrigin origin;
  if (text.size() > kMaxCharacters) return refused("is too long");
  while (!text.empty()) {
    const std::size_t end = text.find(';');
    const std::string_view entry = text.substr(0, end);
    const std::size_t equals = entry.find('=');
    const std::string_view key = entry.substr(0, equals);
    const bool good = equals != std::string_view::npos && is_word(key) &&
                      is_word(entry.substr(equals + 1)) && origin.find(key) == nullptr;
    if (!good || end == text.size() - 1) return refused("is not KEY=VALUE;KEY=VALUE");
    origin.entries.emplace_back(key, entry.substr(equals + 1));
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  }
  return origin;
}

std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run) {
  std::string text;
  const auto compare = [&](const std::string& key) {
    const std::string *const there = recorded.find(key), *const here = run.find(key);
    const bool is_same = there != nullptr && here != nullptr && *there == *here;
    if (key == kOriginProgram || is_same) return;
    if (!text.empty()) text += ", ";
    if (names_file(key)) text += "the ";
    text += key + " (" + shown(there) + ", here " + shown(here) + ")";
  };
  for (const auto& [key, value] : recorded.entries)
    compare(key);
  const std::string* const version = recorded.find(kOriginProgram);
  const std::string* const version_here = run.find(kOriginProgram);
  if (version == nullptr || version_here == nullptr || *version != *version_here) return text;
  for (const auto& [key, value] : run.entries) {
    if (recorded.find(key) == nullptr) compare(key);
  }
  return text;
}

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

bool is_partial_name(std::string_view name) {
  const std::size_t number = name.find_last_not_of("0123456789");
  if (number != std::string_view::npos && number + 1 < name.size() && name[number] == '.')
    name = name.substr(0, number);
  return name.ends_with(kPartialSuffix);
}

bool is_being_recorded(const std::filesystem::path& partial) {
  const FileDescriptor file(
      ::open(partial.c_str(), O_RDONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC));
  return file.get() >= 0 && ::flock(file.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

RecordingWriter::RecordingWriter(std::filesystem::path file, std::string partial, FileDescriptor fd,
                                 const RecordingKind& kind)
    : file_(std::move(file)),
      partial_(std::move(partial)),
      fd_(std::move(fd)),
      kind_(kind),
      rows_in_(partial_),
      flushed_at_(SteadyClock::now()) {}

RecordingWriter::~RecordingWriter() {
  if (fd_.get() >= 0) static_cast<void>(flush());
  end();
}

/// Closes the partial file, and removes it if it has no row.
void RecordingWriter::end() {
  if (fd_.get() < 0) return;
  ::fsync(fd_.get());
  static_cast<void>(fd_.close());
  if (lines_ < 2) ::unlink(partial_.c_str());
}

Error RecordingWriter::failure(int error) const {
  return unwritable(file_.string() + ": " + system_message(error));
}

std::string RecordingWriter::kept() const {
  return lines_ < 2
             ? "no row was kept"
             : "the first " + std::to_string(lines_ - 1) + " rows are in " + rows_in_.string();
}

double RecordingWriter::bytes_per_row() const {
  return rows_ == 0 ? 0 : static_cast<double>(bytes_) / static_cast<double>(rows_);
}

std::optional<std::uint64_t> RecordingWriter::free_bytes() const {
  struct statvfs disk {};
  if (::fstatvfs(fd_.get(), &disk) != 0) return std::nullopt;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

Result<RecordingWriter> RecordingWriter::open(const std::filesystem::path& file,
                                              const RecordingOrigin& origin) {
  if (const Result<void> ok = check_writable(file); !ok) return ok.error();
  const std::string partial = file.string() + kPartialSuffix;
  const int fd = open_partial(partial);
  if (fd < 0 && errno == EWOULDBLOCK)
    return unwritable(partial + ": another program is recording there");
  if (fd < 0) return unwritable(partial + ": " + system_message(errno));
  const RecordingKind kind = recording_kind(origin);
  RecordingWriter writer(file, partial, FileDescriptor(fd), kind);
  writer.buffer_.reserve(kFlushBytes + (std::size_t{1} << 14));
  writer.buffer_ = recording_header(kind) + "\n";
  writer.origin_ = to_text(origin);
  if (Result<void> flushed = writer.flush(); !flushed) return flushed.error();
  return writer;
}

Result<void> RecordingWriter::append(std::span<const RecordingRow> rows) {
  for (const RecordingRow& row : rows) {
    const std::size_t before = buffer_.size();
    RowWriter fields(buffer_);
    visit_fields(row, kind_, fields);
    ++rows_;
    bytes_ += buffer_.size() - before;
    buffer_ += std::exchange(origin_, {});
    buffer_ += '\n';
  }
  const bool is_due = SteadyClock::now() - flushed_at_ >= kFlushWithin;
  return buffer_.size() >= kFlushBytes || (is_due && !buffer_.empty()) ? flush() : Result<void>{};
}

Result<void> RecordingWriter::flush() {
  std::size_t done = 0;
  int error = 0;
  while (done < buffer_.size() && error == 0) {
    const ssize_t put = ::write(fd_.get(), buffer_.data() + done, buffer_.size() - done);
    if (put >= 0)
      done += static_cast<std::size_t>(put);
    else if (errno != EINTR)
      error = errno;
  }
  if (error != 0) {
    // The incomplete last row is removed. If that fails, too, the next call goes on within the row.
    const std::size_t whole = std::string_view(buffer_).substr(0, done).rfind('\n') + 1;
    const off_t end = ::lseek(fd_.get(), 0, SEEK_CUR),
                whole_end = end - static_cast<off_t>(done - whole);
    if (whole < done && end >= 0 && ::ftruncate(fd_.get(), whole_end) == 0 &&
        ::lseek(fd_.get(), whole_end, SEEK_SET) >= 0)
      done = whole;
  }
  const auto written = buffer_.begin() + static_cast<std::ptrdiff_t>(done);
  lines_ += static_cast<std::uint64_t>(std::count(buffer_.begin(), written, '\n'));
  buffer_.erase(buffer_.begin(), written);
  flushed_at_ = error == 0 ? SteadyClock::now() : SteadyClock::time_point{};
  return error == 0 ? Result<void>{} : failure(error);
}

Result<void> RecordingWriter::commit() {
  if (Result<void> flushed = flush(); !flushed) return flushed;
  if (lines_ < 2) {
    end();
    return {};
  }
  struct stat replaced {};
  if (::stat(file_.c_str(), &replaced) == 0)
    static_cast<void>(::fchmod(fd_.get(), replaced.st_mode & 0777));
  if (::fsync(fd_.get()) != 0) return failure(errno);
  if (!fd_.close()) return failure(errno);
  if (::rename(partial_.c_str(), file_.c_str()) != 0) return failure(errno);
  rows_in_ = file_;
  return {};
}

}  // namespace trocar
