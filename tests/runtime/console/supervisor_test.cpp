// SPDX-License-Identifier: Apache-2.0
// The end of a session and of its device process, with shell scripts in the place of the programs.
#include "runtime/console/supervisor.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
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

/// The process of a session whose loop has ended. It still writes its files until `pipe` is closed.
[[noreturn]] void end_session(const fs::path& link, int pipe) {
  TelemetrySizes sizes;
  sizes.about = R"({"schema": "trocar.live/1"})";
  sizes.columns = 1;
  const auto writer = TelemetryWriter::make(sizes);
  if (!writer || !(*writer)->link(link)) ::_exit(1);
  TelemetryEvent ended;
  ended.kind = TelemetryEventKind::kEnded;
  (*writer)->event(ended);
  char none = 0;
  ::_exit(::read(pipe, &none, 1) == 0 ? 0 : 1);
}

TEST(Supervisor, TheStateOfAnEndedSessionNamesAnEmergencyStopThatCameTooLateForIt) {
  const test::TemporaryFolder folder;
  Supervisor::Settings settings;
  settings.folder = settings.programs = folder.path();
  settings.sessions = folder / "sessions";
  fs::create_directories(settings.sessions);
  enum class After { kNothing, kEmergencyStop, kEmergencyStopAndStop };
  for (const After after : {After::kNothing, After::kEmergencyStop, After::kEmergencyStopAndStop}) {
    const bool is_stopped = after == After::kEmergencyStop;
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe(pipe.data()), 0);
    const pid_t session = ::fork();
    ASSERT_GE(session, 0);
    if (session == 0) {
      ::close(pipe[1]);
      end_session(settings.sessions / "live", pipe[0]);
    }
    ::close(pipe[0]);
    Supervisor supervisor(settings);
    EXPECT_TRUE(comes_true([&] {
      supervisor.poll(Supervisor::Clock::now());
      return supervisor.telemetry().has_ended();
    }));
    EXPECT_EQ(supervisor.state(), RunState::kRunning);
    // There is no force to stop any more, but perhaps a page that waits to restart the session.
    if (after != After::kNothing) {
      EXPECT_FALSE(supervisor.emergency_stop());
    }
    if (after == After::kEmergencyStopAndStop) {
      EXPECT_TRUE(supervisor.command(TelemetryCommand::kStop));
    }
    ::close(pipe[1]);
    EXPECT_TRUE(comes_true([&] {
      supervisor.poll(Supervisor::Clock::now());
      return supervisor.state() == RunState::kEnded;
    })) << supervisor.state_json();
    EXPECT_EQ(supervisor.state_json().find(R"("emergency_stop":true)") != std::string::npos,
              is_stopped)
        << supervisor.state_json();
    ::waitpid(session, nullptr, 0);
  }
}

}  // namespace
}  // namespace trocar::runtime
