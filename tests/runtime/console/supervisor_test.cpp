// SPDX-License-Identifier: Apache-2.0
// The end of a session and of its device process, with shell scripts in the place of the programs.
#include "runtime/console/supervisor.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
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

/// The process of a session. Its loop has ended (`has_ended`), or it takes no commands. The process
/// lives until `pipe` is closed.
[[noreturn]] void be_session(const fs::path& link, int pipe, bool has_ended) {
  TelemetrySizes sizes;
  sizes.about = R"({"schema": "trocar.live/1"})";
  sizes.columns = 1;
  const auto writer = TelemetryWriter::make(sizes);
  if (!writer || !(*writer)->link(link)) ::_exit(1);
  TelemetryEvent ended;
  ended.kind = TelemetryEventKind::kEnded;
  if (has_ended) (*writer)->event(ended);
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
      be_session(settings.sessions / "live", pipe[0], true);
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

// A session that another program has started appears while this console starts one, or after it has
// stopped a start.
TEST(Supervisor, ASessionThatIsFoundIsNotTakenForTheStartBeforeIt) {
  for (const bool is_start_stopped : {false, true}) {
    const test::TemporaryFolder folder;
    Supervisor::Settings settings;
    settings.folder = folder.path();
    settings.programs = folder / "programs";
    settings.sessions = folder / "sessions";
    fs::create_directories(settings.sessions);
    fs::create_directories(settings.programs);
    const fs::path scene = folder / "scene.json";
    std::ofstream(scene) << "{}";
    for (const char* name : {"trocar-device-sim", "trocar-run"})
      write_program(settings.programs / name, "while :; do sleep 0.01; done");
    Supervisor supervisor(settings);
    StartRequest request;
    request.scene = scene;
    request.device.name = is_start_stopped ? kInProcess : kSimulator;
    ASSERT_TRUE(supervisor.start(request));
    if (is_start_stopped) {
      ASSERT_TRUE(supervisor.command(TelemetryCommand::kStop));
      ASSERT_TRUE(comes_true([&] {
        supervisor.poll(Supervisor::Clock::now());
        return supervisor.state() == RunState::kIdle;
      }));
    }
    std::array<int, 2> pipe{};
    ASSERT_EQ(::pipe(pipe.data()), 0);
    const pid_t session = ::fork();
    ASSERT_GE(session, 0);
    if (session == 0) {
      ::close(pipe[1]);
      be_session(settings.sessions / "live", pipe[0], is_start_stopped);
    }
    ::close(pipe[0]);
    EXPECT_TRUE(comes_true([&] {
      supervisor.poll(Supervisor::Clock::now());
      return supervisor.telemetry().is_attached();
    }));
    EXPECT_EQ(supervisor.state(), RunState::kRunning);
    // The session does not confirm that its torques are zero, so it is killed.
    if (!is_start_stopped) {
      EXPECT_TRUE(supervisor.emergency_stop());
    }
    if (is_start_stopped) ::close(pipe[1]);
    const RunState end = is_start_stopped ? RunState::kEnded : RunState::kLost;
    EXPECT_TRUE(comes_true([&] {
      supervisor.poll(Supervisor::Clock::now());
      return supervisor.state() == end;
    })) << supervisor.state_json();
    if (!is_start_stopped) ::close(pipe[1]);
    ::kill(session, SIGKILL);
    ::waitpid(session, nullptr, 0);
  }
}

}  // namespace
}  // namespace trocar::runtime
