// SPDX-License-Identifier: Apache-2.0
// The end of a session and of its device process, with shell scripts in the place of the programs.
#include "runtime/console/supervisor.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

#include "tests/support/temporary_folder.h"

namespace trocar::runtime {
namespace {

namespace fs = std::filesystem;

void write_program(const fs::path& file, const std::string& script) {
  std::ofstream(file) << "#!/bin/sh\n" << script << "\n";
  fs::permissions(file, fs::perms::owner_all);
}

// Calls `done` every few milliseconds until it returns true; false after 20 s.
template <typename Done>
bool comes_true(const Done& done) {
  for (int i = 0; i < 4000; ++i) {
    if (done()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

TEST(Supervisor, ADeviceEndsWellAlsoIfTheSessionMustBeKilled) {
  const test::TemporaryFolder folder;
  const fs::path programs = folder.path() / "programs", scene = folder.path() / "scene.json";
  fs::create_directories(programs);
  std::ofstream(scene) << "{}";
  write_program(programs / "trocar-device-sim",
                "trap 'sleep 0.2; : >\"$0.ended_well\"; exit 0' TERM\n"
                "echo 'ready on 127.0.0.1:1'\n"
                "while :; do sleep 0.01; done");
  write_program(programs / "trocar-run",
                "trap '' INT\n: >\"$0.began\"\nwhile :; do sleep 0.01; done");
  Supervisor::Settings settings;
  settings.folder = folder.path();
  settings.sessions = folder.path() / "sessions";
  settings.programs = programs;
  Supervisor supervisor(settings);
  StartRequest request;
  request.scene = scene;
  request.device.name = kSimulator;
  ASSERT_TRUE(supervisor.start(request));
  ASSERT_TRUE(comes_true([&] {
    supervisor.poll(Supervisor::Clock::now());
    return fs::exists(programs / "trocar-run.began");
  }));
  EXPECT_TRUE(comes_true([&] {
    supervisor.poll(Supervisor::Clock::now());
    return supervisor.end_all(Supervisor::Clock::now(), std::chrono::seconds(1));
  }));
  EXPECT_TRUE(fs::exists(programs / "trocar-device-sim.ended_well"));
}

}  // namespace
}  // namespace trocar::runtime
