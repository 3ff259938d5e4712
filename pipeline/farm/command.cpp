// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/command.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <thread>

#include "formats/base/file_io.h"
#include "formats/base/system_message.h"
#include "pipeline/farm/processes.h"

namespace trocar::farm {
namespace {

namespace fs = std::filesystem;
constexpr std::chrono::milliseconds kPoll{5};
constexpr std::uint64_t kMaxMessageBytes = std::uint64_t{1} << 20;

// The child's part between fork() and exec(), which may call only functions that are safe after a
// fork of a process with threads.
[[noreturn]] void execute(const std::vector<char*>& words, const std::vector<char*>& environment,
                          const Command& command) {
  const auto redirect = [](const fs::path& file, int to) {
    const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    return fd >= 0 && ::dup2(fd, to) >= 0;
  };
  const bool is_ready = redirect(command.output, STDOUT_FILENO) &&
                        redirect(command.errors, STDERR_FILENO) &&
                        (command.folder.empty() || ::chdir(command.folder.c_str()) == 0);
  if (is_ready) ::execve(words[0], words.data(), environment.data());
  ::_exit(127);
}

// Pointers to the texts, with a null pointer behind them.
std::vector<char*> pointers_to(std::vector<std::string>& texts) {
  std::vector<char*> out;
  out.reserve(texts.size() + 1);
  for (std::string& text : texts)
    out.push_back(text.data());
  out.push_back(nullptr);
  return out;
}

// The environment of this process, and kExitForNowVariable.
std::vector<std::string> environment_of_command() {
  std::vector<std::string> out = {std::string(kExitForNowVariable) + "=1"};
  for (char** one = ::environ; one != nullptr && *one != nullptr; ++one)
    out.emplace_back(*one);
  return out;
}

// The last line of a message of a program, without "NAME: " in front.
std::string last_line(const fs::path& file, const std::string& program) {
  const auto bytes = read_file(file, kMaxMessageBytes);
  if (!bytes) return "";
  std::string text(bytes->begin(), bytes->end());
  while (!text.empty() && text.back() == '\n')
    text.pop_back();
  text.erase(0, text.rfind('\n') + 1);
  const std::string name = program.substr(program.rfind('/') + 1) + ": ";
  return text.starts_with(name) ? text.substr(name.size()) : text;
}

Error error_of(int status, const Command& command) {
  std::string message = last_line(command.errors, command.words[0]);
  if (WIFSIGNALED(status))
    return {ExitCode::kBug, "it was killed by signal " + std::to_string(WTERMSIG(status)), true};
  const int code = WEXITSTATUS(status);
  if (message.empty()) message = "it ended with exit code " + std::to_string(code);
  switch (code) {
    case 2:
      return usage(message);
    case 3:
      return refused(message);
    case 4:
      return {ExitCode::kUnwritable, message, true};
    case kExitForNow:
      return refused_for_now(message);
    default:
      return {ExitCode::kBug, message, true};
  }
}

}  // namespace

Result<void> run_command(const Command& command, const std::atomic<bool>* stop) {
  std::vector<std::string> copies = command.words, settings = environment_of_command();
  const std::vector<char*> words = pointers_to(copies), environment = pointers_to(settings);
  const pid_t pid = fork_with_signal(SIGKILL);
  if (pid < 0)
    return Error{ExitCode::kBug, "cannot start " + command.words[0] + ": " + system_message(errno),
                 true};
  if (pid == 0) execute(words, environment, command);
  int status = 0;
  for (;;) {
    const pid_t ended = ::waitpid(pid, &status, WNOHANG);
    if (ended == pid) break;
    if (ended < 0 && errno != EINTR) return bug("waitpid: " + system_message(errno));
    if (stop != nullptr && stop->load()) ::kill(pid, SIGKILL);
    std::this_thread::sleep_for(kPoll);
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  return error_of(status, command);
}

}  // namespace trocar::farm
