// SPDX-License-Identifier: Apache-2.0
#include "runtime/telemetry/black_box.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <system_error>
#include <utility>

#include "formats/base/file_io.h"
#include "formats/base/text_line.h"
#include "formats/base/utc_time.h"

namespace trocar::runtime {
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
  for (int again = 2; std::filesystem::exists(file, ignored); ++again) {
    file = folder_ / (stem + "_" + std::to_string(again) + ".csv");
  }
  return file;
}

void BlackBox::serve_one(const Request& request) {
  BlackBoxFile made;
  made.fault = request.fault;
  made.t_s = request.t_s;
  made.file = name_of(request);
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

}  // namespace trocar::runtime
