// SPDX-License-Identifier: Apache-2.0
#include "runtime/session/recorder.h"

#include <fcntl.h>

#include "formats/base/text.h"

namespace trocar::runtime {

TickFeed::TickFeed(std::function<void(const ObservedTick&)> observe)
    : TickObserver(std::chrono::milliseconds(20)), observe_(std::move(observe)) {}

void TickFeed::on_tick(const TickView& tick) noexcept {
  ObservedTick observed;
  observed.row = tick.result.row;
  for (const CutRequest& cut : tick.result.contact.cuts())
    (cut.is_puncture ? observed.punctured : observed.side_cut) |= std::uint64_t{1} << cut.sheet;
  observed.layers_punctured = tick.result.contact.layers_punctured;
  observed.tip_N = tick.result.contact.force_before_N;
  observed.break_through = tick.result.break_through;
  if (!ticks_.push(observed)) lost_.fetch_add(1, std::memory_order_relaxed);
}

void TickFeed::serve() {
  ObservedTick tick;
  while (ticks_.pop(tick))
    observe_(tick);
}

namespace {

constexpr unsigned kFirstOctave = 8;  // 2^8 ns = 256 ns

constexpr auto kMeasureEvery = std::chrono::milliseconds(200);

}  // namespace

std::size_t TelemetryHistogram::bin(std::int64_t duration_ns) noexcept {
  if (duration_ns < std::int64_t{1} << kFirstOctave) return 0;
  const auto value = static_cast<std::uint64_t>(duration_ns);
  const unsigned octave = static_cast<unsigned>(std::bit_width(value)) - 1;
  const std::uint64_t quarter = (value >> (octave - 2)) & 3U;
  return std::min<std::size_t>(std::size_t{4} * (octave - kFirstOctave) + quarter, kBins - 1);
}

double TelemetryHistogram::lower_us(std::size_t i) noexcept {
  if (i == 0) return 0;
  return std::ldexp(1 + 0.25 * static_cast<double>(i % 4), static_cast<int>(kFirstOctave + i / 4)) *
         1e-3;
}

Result<DiskReserve> DiskReserve::hold(const std::filesystem::path& folder) {
  DiskReserve reserve;
  FileDescriptor file(::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600));
  // Unlike posix_fallocate(), this never writes the bytes one by one.
  if (file.get() >= 0 && ::fallocate(file.get(), 0, 0, static_cast<off_t>(kBytes)) == 0) {
    reserve.file_.emplace(std::move(file));
  } else if (errno == ENOSPC || errno == EDQUOT) {
    return unwritable(folder.string() +
                      ": less than 1 MiB is free on the disk: " + system_message(errno));
  }
  return reserve;
}

BlackBox::BlackBox(std::filesystem::path folder, std::string name, std::size_t rows_of_file,
                   RecordingOrigin origin)
    : TickObserver(std::chrono::milliseconds(10)),
      folder_(std::move(folder)),
      name_(std::move(name)),
      rows_of_file_(rows_of_file),
      origin_(std::move(origin)),
      ring_(2 * rows_of_file) {}

Result<std::unique_ptr<BlackBox>> BlackBox::make(const std::filesystem::path& folder,
                                                 double rate_Hz, const RecordingOrigin& origin) {
  const std::string name = "black_box_" + utc_name(std::time(nullptr));
  if (const Result<void> good = check_writable(folder / name); !good) {
    const std::string& why = good.error().message;  // FILE: REASON
    return unwritable(folder.string() + ": no folder for black boxes: " +
                      why.substr((folder / name).string().size() + 2) +
                      " (--black-box sets another)");
  }
  const auto rows = static_cast<std::size_t>(std::ceil(kBlackBox_s * rate_Hz - 1e-6));
  return std::unique_ptr<BlackBox>(
      new BlackBox(folder, name, std::max<std::size_t>(rows, 1), origin));
}

bool BlackBox::save(Fault fault, double t_s) noexcept {
  if (requests_.push({fault, t_s, ring_.pushed()})) return true;
  lost_.fetch_add(1, std::memory_order_relaxed);
  return false;
}

void BlackBox::on_tick(const TickView& tick) noexcept {
  push(tick.result.row);
  if (const Fault fault = tick.result.new_fault; fault != Fault::kNone)
    is_pending_ = is_failure(fault);
  if (!is_pending_) return;
  latched_ = tick.state.safety.fault;
  latched_t_s_ = tick.state.safety.fault_t_s;
  if (!tick.result.torques_are_zero) return;
  is_pending_ = false;
  save(latched_, latched_t_s_);
}

std::filesystem::path BlackBox::name_of(const Request& request) const {
  const std::string stem =
      name_ + "_t" + text_line("%.4f", request.t_s) + "s_" + to_string(request.fault);
  std::filesystem::path file = folder_ / (stem + ".csv");
  std::error_code ignored;
  for (int again = 2; std::filesystem::exists(file, ignored); ++again)
    file = folder_ / (stem + "_" + std::to_string(again) + ".csv");
  return file;
}

void BlackBox::serve_one(const Request& request) {
  BlackBoxFile made{.fault = request.fault, .t_s = request.t_s, .file = name_of(request)};
  const std::uint64_t first = request.end - std::min<std::uint64_t>(request.end, rows_of_file_);
  std::vector<RecordingRow> rows;
  const bool kept = ring_.copy(first, request.end, rows);
  made.rows = rows.size();
  if (!kept) {
    made.error =
        unwritable(made.file.string() +
                   ": rows were overwritten before they could be copied: the machine is too slow");
  } else if (Result<RecordingWriter> writer = RecordingWriter::open(made.file, origin_); !writer) {
    made.error = writer.error();
  } else {
    Result<void> done = writer->append(rows);
    if (done) done = writer->commit();
    if (!done) made.error = unwritable(done.error().message + "; " + writer->kept());
  }
  files_.push_back(std::move(made));
}

void BlackBox::serve() {
  Request request;
  while (requests_.pop(request))
    serve_one(request);
}

void BlackBox::stop() {
  join();
  if (std::exchange(is_pending_, false)) save(latched_, latched_t_s_);
  serve();
}

Recorder::Recorder(RecordingWriter writer, DiskReserve reserve, double rate_Hz,
                   std::function<void(double)> low_space)
    : TickObserver(std::chrono::milliseconds(20)),
      writer_(std::move(writer)),
      reserve_(std::move(reserve)),
      rate_Hz_(rate_Hz),
      low_space_(std::move(low_space)) {}

Result<std::unique_ptr<Recorder>> Recorder::make(const std::filesystem::path& file,
                                                 const RecordingOrigin& origin, double rate_Hz,
                                                 std::function<void(double)> low_space) {
  Result<RecordingWriter> writer = RecordingWriter::open(file, origin);
  if (!writer) return writer.error();
  Result<DiskReserve> reserve =
      DiskReserve::hold(file.has_parent_path() ? file.parent_path() : std::filesystem::path("."));
  if (!reserve) return reserve.error();
  return std::unique_ptr<Recorder>(
      new Recorder(std::move(*writer), std::move(*reserve), rate_Hz, std::move(low_space)));
}

void Recorder::serve() {
  std::array<RecordingRow, 64> batch;
  std::size_t count = 0;
  while (rows_.pop(batch[count])) {
    if (++count == batch.size()) write(std::span(batch.data(), std::exchange(count, 0)));
  }
  write(std::span(batch.data(), count));
  if (is_full_.load(std::memory_order_relaxed) && !error_)
    fail(unwritable(writer_.file().string() + ": the disk is too slow for the rows"));
  if (!error_) measure_space();
}

void Recorder::write(std::span<const RecordingRow> rows) {
  Result<void> done = writer_.append(rows);
  if (done || error_) return;
  fail(done.error());
  static_cast<void>(writer_.append({}));  // again, now that there is space
}

void Recorder::fail(const Error& error) {
  error_ = error;
  has_failed_.store(true, std::memory_order_relaxed);
  reserve_.release();
}

void Recorder::measure_space() {
  const auto now = std::chrono::steady_clock::now();
  if (writer_.bytes_per_row() == 0 || now - measured_at_ < kMeasureEvery) return;
  measured_at_ = now;
  const std::optional<std::uint64_t> free_bytes = writer_.free_bytes();
  if (!free_bytes) return;
  const double left_s = static_cast<double>(*free_bytes) / (writer_.bytes_per_row() * rate_Hz_);
  left_s_.store(left_s, std::memory_order_relaxed);
  if (left_s >= kLowSpace_s || std::exchange(is_low_, true)) return;
  if (low_space_) low_space_(left_s);
}

Result<void> Recorder::finish() {
  stop();
  const Result<void> done = writer_.commit();
  if (done && !error_) return {};
  if (!error_) error_ = done.error();
  return Error{error_->code, error_->message + "; " + writer_.kept()};
}

}  // namespace trocar::runtime
