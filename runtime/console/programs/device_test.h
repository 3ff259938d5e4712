// SPDX-License-Identifier: Apache-2.0
// Tests a device before a session: the console runs trocar-run test. In the test the
// device gets no force.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "formats/base/result.h"
#include "runtime/console/programs/brief_run.h"
#include "runtime/console/programs/device_choice.h"

namespace trocar::runtime {

class DeviceTest {
 public:
  using Clock = BriefRun::Clock;

  /// Starts a test. `programs`: the folder that contains trocar-run. The files of the test go into
  /// a new folder in `sessions`. Precondition: is_running() is false. Errors: those of
  /// create_session_folder() and BriefRun::start().
  Result<void> start(const DeviceChoice& device, const std::filesystem::path& programs,
                     const std::filesystem::path& sessions);
  bool is_running() const noexcept { return run_.is_running(); }
  void stop(Clock::time_point now) { run_.stop(now); }
  /// Checks whether the test has ended. The caller must call this every few milliseconds.
  void poll(Clock::time_point now) { run_.poll(now); }
  /// Returns a function that makes the answer to GET /api/test (protocol.md). The function reads
  /// files, so call it on the worker thread.
  std::function<std::string()> answer(const HiddenTexts& hidden) const;

 private:
  BriefRun run_;
  std::filesystem::path folder_;
  std::string device_;
};

}  // namespace trocar::runtime
