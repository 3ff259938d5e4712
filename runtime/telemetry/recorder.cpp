// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/recorder.h"

#include <array>
#include <span>
#include <utility>

namespace trocar::runtime {
namespace {

constexpr auto kMeasureEvery = std::chrono::milliseconds(200);

}  // namespace

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
