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
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>

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

/// The process of a session that this console has not started. Its loop has ended (`has_ended`), or
/// it takes no commands. It ends when end() is called, as a session does that has written its files.
class OtherSession {
 public:
  OtherSession(const fs::path& link, bool has_ended) {
    std::array<int, 2> pipe{};
    if (::pipe(pipe.data()) != 0) throw std::runtime_error("no pipe");
    pid_ = ::fork();
    if (pid_ == 0) {
      ::close(pipe[1]);
      run(link, pipe[0], has_ended);
    }
    ::close(pipe[0]);
    pipe_ = pipe[1];
  }
  OtherSession(const OtherSession&) = delete;
  OtherSession& operator=(const OtherSession&) = delete;
  ~OtherSession() {
    end();
    ::waitpid(pid_, nullptr, 0);
  }
  void end() {
    if (pipe_ >= 0) ::close(std::exchange(pipe_, -1));
  }
  bool runs() const { return ::waitpid(pid_, nullptr, WNOHANG) == 0; }

 private:
  [[noreturn]] static void run(const fs::path& link, int pipe, bool has_ended) {
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

  pid_t pid_ = -1;
  int pipe_ = -1;
};

TEST(Supervisor, TheStateOfAnEndedSessionNamesAnEmergencyStopThatCameTooLateForIt) {
  const test::TemporaryFolder folder;
  Supervisor::Settings settings;
  settings.folder = settings.programs = folder.path();
  settings.sessions = folder / "sessions";
  fs::create_directories(settings.sessions);
  enum class After { kNothing, kEmergencyStop, kEmergencyStopAndStop };
  for (const After after : {After::kNothing, After::kEmergencyStop, After::kEmergencyStopAndStop}) {
    const bool is_stopped = after == After::kEmergencyStop;
    OtherSession session(settings.sessions / "live", true);
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
    session.end();
    EXPECT_TRUE(comes_true([&] {
      supervisor.poll(Supervisor::Clock::now());
      return supervisor.state() == RunState::kEnded;
    })) << supervisor.state_json();
    EXPECT_EQ(supervisor.state_json().find(R"("emergency_stop":true)") != std::string::npos,
              is_stopped)
        << supervisor.state_json();
  }
}

// A console whose programs begin and then do nothing.
struct IdlePrograms {
  test::TemporaryFolder folder;
  Supervisor::Settings settings;
  StartRequest request;

  explicit IdlePrograms(const char* device) {
    settings.folder = folder.path();
    settings.programs = folder / "programs";
    settings.sessions = folder / "sessions";
    fs::create_directories(settings.sessions);
    fs::create_directories(settings.programs);
    request.scene = folder / "scene.json";
    std::ofstream(request.scene) << "{}";
    request.device.name = device;
    for (const char* name : {"trocar-device-sim", "trocar-run"})
      write_program(settings.programs / name, "while :; do sleep 0.01; done");
  }
};

bool comes_to(Supervisor& supervisor, RunState state) {
  return comes_true([&] {
    supervisor.poll(Supervisor::Clock::now());
    return supervisor.state() == state;
  });
}

TEST(Supervisor, ASessionThatIsFoundDuringAStartGetsTheEmergencyStop) {
  const IdlePrograms console(kSimulator);
  Supervisor supervisor(console.settings);
  ASSERT_TRUE(supervisor.start(console.request));
  const OtherSession session(console.settings.sessions / "live", false);
  ASSERT_TRUE(comes_to(supervisor, RunState::kRunning));
  EXPECT_TRUE(supervisor.emergency_stop());
  // The session does not confirm that its torques are zero, so it is killed.
  EXPECT_TRUE(comes_to(supervisor, RunState::kLost)) << supervisor.state_json();
}

TEST(Supervisor, ASessionThatIsFoundAfterAStoppedStartHasItsOwnEnd) {
  const IdlePrograms console(kInProcess);
  Supervisor supervisor(console.settings);
  ASSERT_TRUE(supervisor.start(console.request));
  ASSERT_TRUE(supervisor.command(TelemetryCommand::kStop));
  ASSERT_TRUE(comes_to(supervisor, RunState::kIdle));
  OtherSession session(console.settings.sessions / "live", true);
  ASSERT_TRUE(comes_to(supervisor, RunState::kRunning));
  session.end();
  EXPECT_TRUE(comes_to(supervisor, RunState::kEnded)) << supervisor.state_json();
}

TEST(Supervisor, ASessionThatAnotherConsoleStartedGoesOnWhenThisOneEnds) {
  const IdlePrograms console(kInProcess);
  const OtherSession session(console.settings.sessions / "live", false);
  Supervisor supervisor(console.settings);
  ASSERT_TRUE(comes_to(supervisor, RunState::kRunning));
  const auto now = Supervisor::Clock::now();
  EXPECT_TRUE(supervisor.end_all(now, std::chrono::seconds(1)));
  EXPECT_TRUE(supervisor.end_all(now + std::chrono::seconds(2), std::chrono::seconds(1)));
  const auto reader = TelemetryReader::open(console.settings.sessions / "live");
  ASSERT_TRUE(reader) << "the session has ended";
  TelemetryEvent event;
  std::uint64_t lost = 0;
  EXPECT_EQ((*reader)->next_event(event, lost), TelemetryReader::Next::kNone);
  std::this_thread::sleep_for(std::chrono::milliseconds(50));  // a signal would have come
  EXPECT_TRUE(session.runs());
}

}  // namespace
}  // namespace trocar::runtime
