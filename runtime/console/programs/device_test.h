// SPDX-License-Identifier: Apache-2.0
// A test of a device before a session: trocar-run --test as a process of the console. The device
// gets no force.
// Tests: tests/e2e/console_device_test.py
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

  /// Starts a test, which must not run yet. Its files go into a new folder in `sessions`. Errors:
  /// (refused, unwritable) the folder or the process cannot be made.
  Result<void> start(const DeviceChoice& device, const std::filesystem::path& programs,
                     const std::filesystem::path& sessions);
  bool is_running() const noexcept { return run_.is_running(); }
  void stop(Clock::time_point now) { run_.stop(now); }
  /// Notices the end of the test. The caller must call this every few milliseconds.
  void poll(Clock::time_point now) { run_.poll(now); }
  /// Returns a function that makes the answer to GET /api/test (protocol.md). It reads files.
  std::function<std::string()> answer(const HiddenTexts& hidden) const;

 private:
  BriefRun run_;
  std::filesystem::path folder_;
  std::string device_;
};

}  // namespace trocar::runtime
