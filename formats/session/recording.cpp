// SPDX-License-Identifier: Apache-2.0
#include "formats/session/recording.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/session/fault_words.h"

namespace trocar {
namespace {

constexpr std::size_t kFlushBytes = std::size_t{1} << 20;
constexpr std::array<const char*, 5> kPhaseNames = {"free", "contact", "punctured", "beside",
                                                    "fault"};
/// Columns that recordings of older versions do not have.
constexpr std::array<const char*, 2> kLaterColumns = {"state_t_s", "origin"};
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

/// Columns of the force law `cutting`.
constexpr std::array<const char*, 14> kCuttingColumns = {
    "fx_tissue_N",  "fy_tissue_N", "fz_tissue_N",     "tx_tissue_Nm", "ty_tissue_Nm",
    "tz_tissue_Nm", "front_z_m",   "front_HU",        "tip_N",        "embedded_m",
    "cut_J",        "absorbed_J",  "tissue_stored_J", "steps"};

std::vector<std::string> make_columns(bool with_cutting) {
  std::vector<std::string> columns = {"t_s", "x_m", "y_m",      "z_m",      "qw",      "qx",
                                      "qy",  "qz",  "tool_x_m", "tool_y_m", "tool_z_m"};
  for (const char* kind : {"wanted", "delivered"}) {
    for (const char* axis : {"fx", "fy", "fz"}) {
      columns.push_back(std::string(axis) + "_" + kind + "_N");
    }
    for (const char* axis : {"tx", "ty", "tz"}) {
      columns.push_back(std::string(axis) + "_" + kind + "_Nm");
    }
  }
  for (int leg = 1; leg <= 4; ++leg) {
    for (const int joint : {1, 4}) {
      columns.push_back("tau_" + std::to_string(leg) + "_" + std::to_string(joint) + "_Nm");
    }
  }
  for (int leg = 1; leg <= 4; ++leg) {
    for (int joint = 1; joint <= 4; ++joint) {
      columns.push_back("th_" + std::to_string(leg) + "_" + std::to_string(joint) + "_rad");
    }
  }
  for (const char* name :
       {"state",           "active_slice",   "penetration_m",  "wrench_scale",
        "pose_residual_m", "cuts_published", "response_sheet", "response_stiffness_N_per_m",
        "response_x_m",    "response_y_m",   "fault",          "device_read",
        "state_t_s",       "device_write",   "outside_fault",  "recovery_asked",
        "safety",          "authority",      "passivity_J",    "passivity_N_s_per_m",
        "motor_heat_max"}) {
    columns.emplace_back(name);
  }
  if (with_cutting) columns.insert(columns.end(), kCuttingColumns.begin(), kCuttingColumns.end());
  columns.emplace_back("origin");  // the last: text, in the first row only
  return columns;
}

const std::vector<std::string>& columns(bool with_cutting) {
  static const std::array<std::vector<std::string>, 2> names{make_columns(false),
                                                             make_columns(true)};
  return names[with_cutting ? 1 : 0];
}

std::string joined(std::span<const std::string> names) {
  std::string line;
  for (const std::string& name : names)
    line.append(line.empty() ? "" : ",").append(name);
  return line;
}

/// The columns of a recording with this header: all, or those of an older version; empty: it is
/// none.
std::vector<std::string> columns_of(std::string_view header) {
  if (header == joined(columns(true))) return columns(true);
  for (unsigned absent = 0; absent < 1U << kLaterColumns.size(); ++absent) {
    std::vector<std::string> names;
    for (const std::string& name : columns(false)) {
      const auto later = static_cast<std::size_t>(
          std::find(kLaterColumns.begin(), kLaterColumns.end(), name) - kLaterColumns.begin());
      if (later == kLaterColumns.size() || (absent >> later & 1U) == 0) names.push_back(name);
    }
    if (header == joined(names)) return names;
  }
  return {};
}

template <typename Number>
void put(std::string& out, Number x) {
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), x).ptr;
  out.append(text.data(), end);
  out.push_back(',');
}

void put(std::string& out, const char* name) {
  out.append(name).push_back(',');
}

template <std::size_t N>
void put(std::string& out, const std::array<double, N>& numbers) {
  for (const double x : numbers)
    put(out, x);
}

void put(std::string& out, const RecordingRow& row, bool with_cutting) {
  put(out, row.t_s);
  put(out, row.p_m);
  put(out, row.q);
  put(out, row.tool_m);
  put(out, row.wrench_wanted);
  put(out, row.wrench_delivered);
  put(out, row.tau_Nm);
  put(out, row.encoder_rad);
  put(out, to_string(row.phase));
  put(out, row.active_slice);
  put(out, row.penetration_m);
  put(out, row.wrench_scale);
  put(out, row.pose_residual_m);
  put(out, row.cuts_published);
  put(out, row.response_sheet);
  put(out, row.response_stiffness_N_per_m);
  put(out, row.response_offset_m);
  put(out, to_string(row.fault));
  put(out, to_string(row.device_read));
  put(out, row.state_t_s);
  put(out, to_string(row.device_write));
  put(out, to_string(row.outside_fault));
  put(out, row.recovery_asked);
  put(out, to_string(row.safety));
  put(out, row.authority);
  put(out, row.passivity_J);
  put(out, row.passivity_N_s_per_m);
  put(out, row.motor_heat_max);
  if (with_cutting) {
    const RecordingRow::Cutting& cutting = row.cutting;
    put(out, cutting.wrench_tissue);
    put(out, cutting.front_z_m);
    put(out, cutting.front_HU);
    put(out, cutting.tip_N);
    put(out, cutting.embedded_m);
    put(out, cutting.cut_J);
    put(out, cutting.absorbed_J);
    put(out, cutting.stored_J);
    put(out, cutting.steps);
  }
  out.back() = '\n';
}

/// Reads one row field by field; keeps the first error.
class RowReader {
 public:
  explicit RowReader(std::string_view line) : rest_(line) {}

  bool ok() const { return why_ == nullptr; }
  bool at_end() const { return ended_; }
  const char* why() const { return why_; }
  std::size_t field() const { return field_; }  ///< number of fields read so far

  template <typename Number>
  void number(Number& x) {
    const std::string_view text = next();
    if (!ok()) return;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), x);
    if (error != std::errc() || end != text.data() + text.size()) why_ = "is not a number";
  }
  /// The origin: in the first row, empty in others.
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

}  // namespace

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

const std::string& recording_header(bool with_cutting) {
  static const std::array<std::string, 2> headers{joined(columns(false)), joined(columns(true))};
  return headers[with_cutting ? 1 : 0];
}

RecordingWriter::RecordingWriter(std::filesystem::path file, std::string partial, int fd,
                                 bool with_cutting)
    : file_(std::move(file)), partial_(std::move(partial)), fd_(fd), with_cutting_(with_cutting) {}

RecordingWriter::RecordingWriter(RecordingWriter&& other) noexcept
    : file_(std::move(other.file_)),
      partial_(std::exchange(other.partial_, {})),
      fd_(std::exchange(other.fd_, -1)),
      buffer_(std::move(other.buffer_)),
      with_cutting_(other.with_cutting_),
      origin_(std::move(other.origin_)),
      lines_(other.lines_) {}

RecordingWriter::~RecordingWriter() {
  if (fd_ >= 0 && !partial_.empty()) static_cast<void>(flush());
  end();
}

/// Closes the partial file; without a row it is removed.
void RecordingWriter::end() {
  if (fd_ >= 0) {
    ::fsync(fd_);
    ::close(std::exchange(fd_, -1));
  }
  if (!partial_.empty() && lines_ < 2) ::unlink(partial_.c_str());
  partial_.clear();
}

Error RecordingWriter::failure(int error) {
  const std::string kept =
      lines_ < 2 ? "no row was kept"
                 : "the first " + std::to_string(lines_ - 1) + " rows are in " + partial_;
  end();
  return unwritable(file_.string() + ": " + std::generic_category().message(error) + "; " + kept);
}

namespace {

// Gives what an interrupted recording left in `partial` the first free of the names with .1, .2 and
// so on behind. False with errno; EWOULDBLOCK: another program is writing it.
bool move_aside(const std::string& partial) {
  constexpr int kMostKept = 10000;
  const int old = ::open(partial.c_str(), O_WRONLY | O_NONBLOCK | O_NOFOLLOW | O_CLOEXEC);
  if (old < 0) return false;
  bool moved = false;
  if (::flock(old, LOCK_EX | LOCK_NB) == 0) {
    errno = EEXIST;
    // link() overwrites nothing, unlike rename().
    for (int n = 1; n < kMostKept && !moved && errno == EEXIST; ++n)
      moved = ::link(partial.c_str(), (partial + "." + std::to_string(n)).c_str()) == 0;
    moved = moved && ::unlink(partial.c_str()) == 0;
  }
  const int error = errno;
  ::close(old);
  errno = error;
  return moved;
}

// A new file, locked while it is open; -1 with errno, as move_aside().
int open_partial(const std::string& partial) {
  constexpr int kFlags = O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC;
  int fd = ::open(partial.c_str(), kFlags, 0666);
  if (fd < 0 && errno == EEXIST && move_aside(partial)) fd = ::open(partial.c_str(), kFlags, 0666);
  if (fd >= 0) static_cast<void>(::flock(fd, LOCK_EX | LOCK_NB));
  return fd;
}

}  // namespace

Result<RecordingWriter> RecordingWriter::open(const std::filesystem::path& file,
                                              const RecordingOrigin& origin) {
  if (const Result<void> ok = check_writable(file); !ok) return ok.error();
  const std::string partial = file.string() + kPartialSuffix;
  const int fd = open_partial(partial);
  if (fd < 0 && errno == EWOULDBLOCK)
    return unwritable(partial + ": another program is recording there");
  if (fd < 0) return unwritable(partial + ": " + std::generic_category().message(errno));
  const std::string* law = origin.find("force-law");
  const bool with_cutting = law != nullptr && *law == "cutting";
  RecordingWriter writer(file, partial, fd, with_cutting);
  writer.buffer_.reserve(kFlushBytes + (std::size_t{1} << 14));
  writer.buffer_ = recording_header(with_cutting) + "\n";
  writer.origin_ = to_text(origin);
  return writer;
}

Result<void> RecordingWriter::append(std::span<const RecordingRow> rows) {
  for (const RecordingRow& row : rows) {
    put(buffer_, row, with_cutting_);
    buffer_.back() = ',';
    buffer_ += std::exchange(origin_, {});
    buffer_ += '\n';
    if (buffer_.size() < kFlushBytes) continue;
    if (Result<void> flushed = flush(); !flushed) return flushed;
  }
  return {};
}

Result<void> RecordingWriter::flush() {
  std::size_t done = 0;
  int error = 0;
  while (done < buffer_.size() && error == 0) {
    const ssize_t put = ::write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (put >= 0) {
      done += static_cast<std::size_t>(put);
    } else if (errno != EINTR) {
      error = errno;
    }
  }
  const std::string_view written = std::string_view(buffer_).substr(0, done);
  lines_ += static_cast<std::uint64_t>(std::count(written.begin(), written.end(), '\n'));
  if (error == 0) {
    buffer_.clear();
    return {};
  }
  // The row that was cut is removed.
  const std::size_t cut = done - (written.rfind('\n') + 1);  // npos + 1 is 0
  const off_t end = ::lseek(fd_, 0, SEEK_CUR);
  // If that fails too, a reader refuses the cut row and names its line.
  [[maybe_unused]] const bool removed =
      cut == 0 || (end >= 0 && ::ftruncate(fd_, end - static_cast<off_t>(cut)) == 0);
  return failure(error);
}

Result<void> RecordingWriter::commit() {
  if (Result<void> flushed = flush(); !flushed) return flushed;
  if (::fsync(fd_) != 0) return failure(errno);
  if (::close(std::exchange(fd_, -1)) != 0) return failure(errno);
  if (::rename(partial_.c_str(), file_.c_str()) != 0) return failure(errno);
  partial_.clear();
  return {};
}

Result<std::vector<RecordingRow>> parse_recording(std::string_view csv, const std::string& name,
                                                  RecordingOrigin* origin) {
  std::vector<RecordingRow> rows;
  RecordingOrigin found;
  std::size_t line_number = 0;
  std::vector<std::string> columns_here;
  const auto has = [&](std::string_view column) {
    return std::find(columns_here.begin(), columns_here.end(), column) != columns_here.end();
  };
  while (!csv.empty()) {
    ++line_number;
    const std::size_t end = csv.find('\n');
    const std::string where = name + ": line " + std::to_string(line_number);
    if (end == std::string_view::npos) return refused(where + ": has no line feed at its end");
    const std::string_view line = csv.substr(0, end);
    csv.remove_prefix(end + 1);
    if (line_number == 1) {
      columns_here = columns_of(line);
      if (columns_here.empty()) return refused(where + ": is not the header of a recording");
      continue;
    }
    RecordingRow row;
    RowReader reader(line);
    reader.finite(row.t_s);
    reader.finite(row.p_m);
    reader.finite(row.q);
    reader.finite(row.tool_m);
    reader.finite(row.wrench_wanted);
    reader.finite(row.wrench_delivered);
    reader.finite(row.tau_Nm);
    for (double& angle : row.encoder_rad)
      reader.number(angle);
    reader.name(row.phase, kPhaseNames);
    reader.number(row.active_slice);
    reader.finite(row.penetration_m);
    reader.finite(row.wrench_scale);
    reader.finite(row.pose_residual_m);
    reader.number(row.cuts_published);
    reader.number(row.response_sheet);
    reader.number(row.response_stiffness_N_per_m);
    for (double& offset_m : row.response_offset_m)
      reader.number(offset_m);
    reader.name(row.fault, fault_names());
    reader.name(row.device_read, kDeviceStatusNames);
    row.state_t_s = row.t_s;
    if (has("state_t_s")) reader.finite(row.state_t_s);
    reader.name(row.device_write, kDeviceStatusNames);
    reader.name(row.outside_fault, fault_names());
    reader.flag(row.recovery_asked);
    reader.name(row.safety, kSafetyNames);
    reader.finite(row.authority);
    reader.finite(row.passivity_J);
    reader.finite(row.passivity_N_s_per_m);
    reader.finite(row.motor_heat_max);
    if (has("front_z_m")) {
      RecordingRow::Cutting& cutting = row.cutting;
      reader.finite(cutting.wrench_tissue);
      reader.finite(cutting.front_z_m);
      reader.finite(cutting.front_HU);
      reader.finite(cutting.tip_N);
      reader.finite(cutting.embedded_m);
      reader.finite(cutting.cut_J);
      reader.finite(cutting.absorbed_J);
      reader.finite(cutting.stored_J);
      reader.number(cutting.steps);
    }
    if (has("origin")) reader.origin(rows.empty(), found);
    if (!reader.ok()) {
      return refused(where + ": " + columns_here.at(reader.field() - 1) + " " + reader.why());
    }
    if (!reader.at_end()) return refused(where + ": has too many fields");
    if (!rows.empty() && !(row.t_s > rows.back().t_s)) {
      return refused(where + ": t_s is not later than in the row before");
    }
    rows.push_back(row);
  }
  if (rows.empty()) return refused(name + ": has no row");
  if (origin != nullptr) *origin = std::move(found);
  return rows;
}

Result<std::vector<RecordingRow>> read_recording(const std::filesystem::path& file,
                                                 RecordingOrigin* origin) {
  const Result<std::vector<std::uint8_t>> bytes = read_file(file);
  if (!bytes) return bytes.error();
  return parse_recording(
      std::string_view(reinterpret_cast<const char*>(bytes->data()), bytes->size()), file.string(),
      origin);
}

}  // namespace trocar
