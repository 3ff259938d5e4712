// SPDX-License-Identifier: Apache-2.0
// A session of the four-legged device with synthetic slices, in virtual time unless a test says otherwise.
#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "formats/session/recording.h"
#include "runtime/session/open_device.h"
#include "runtime/session/session.h"
#include "tests/support/four_legs_session.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/temporary_folder.h"

namespace trocar::runtime::testing_support {

inline std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

/// Set the members, then run() or replay().
struct TestSession {
  using Advance = std::function<void(double dt_s)>;

  explicit TestSession(const Scene& of, int slices = 1)
      : TestSession(of, test::square_asset(slices)) {}
  TestSession(const Scene& of, Asset with) : scene(of), asset(std::move(with)) {
    options.clock = Clock::kVirtual;
    options.duration_s = scene.duration_s;
    options.limits.gap_max_s = 0;
    options.record = folder / "r.csv";
  }

  /// With the simulated device; `after` is called after each step of it.
  SessionResult run(const std::function<void()>& after = {}) {
    simulate();
    return run(*device, [&](double dt_s) {
      device->step(dt_s);
      if (after) after();
    });
  }
  /// With a device of the test, which may contain `device` of simulate().
  SessionResult run(Device& with, const Advance& advance) {
    if (workers) {
      SessionWorkers prepared = std::move(*workers);
      workers.reset();
      return run_session(placed, description, *remesher, with, advance, options,
                         std::move(prepared));
    }
    place();
    auto report = run_session(placed, description, *remesher, with, advance, options, mechanism);
    EXPECT_TRUE(report) << report.error().message;
    return report ? std::move(*report) : SessionResult{};
  }
  /// Before run(), to open the telemetry: makes what run() makes otherwise.
  void prepare() {
    place();
    auto made = test::make_workers(placed, *remesher, options, description);
    EXPECT_TRUE(made) << made.error().message;
    workers.emplace(std::move(*made));
  }
  void place() {
    placed = scene;
    EXPECT_TRUE(!scene.body || place_body(placed, asset, "asset"));
    auto sheets = place_slices(placed, asset, "asset");
    EXPECT_TRUE(sheets) << sheets.error().message;
    remesher = std::make_unique<Remesher>(*sheets);
  }
  /// Replays rows; `options.record` is written unless it is unset.
  SessionResult replay(const std::vector<RecordingRow>& recorded) {
    ReplayDevice replayed(recorded);
    options.replay = recorded;
    SessionResult report = run(replayed, [](double) {});
    options.replay = {};
    return report;
  }
  void simulate() {
    auto made = make_simulated_device(scene, description);
    EXPECT_TRUE(made) << made.error().message;
    device.emplace(std::move(*made));
  }
  std::vector<RecordingRow> rows() const {
    auto read = read_recording(*options.record);
    EXPECT_TRUE(read) << read.error().message;
    return read ? std::move(*read) : std::vector<RecordingRow>();
  }
  std::string recording() const { return text_of(*options.record); }

  Scene scene, placed;
  Asset asset;
  test::TemporaryFolder folder;
  SessionOptions options;
  DeviceDescription description = default_device_description();
  MechanismLimits mechanism;
  std::optional<SimulatedDevice> device;
  std::unique_ptr<Remesher> remesher;
  std::optional<SessionWorkers> workers;
};

}  // namespace trocar::runtime::testing_support
