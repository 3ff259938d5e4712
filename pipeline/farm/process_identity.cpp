// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/farm/process_identity.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <fstream>
#include <iterator>
#include <sstream>
#include <vector>

#include "pipeline/farm/sha256.h"

namespace trocar::farm {
namespace {

std::string host_name() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) return "unknown";
  std::string out = name.data();
  std::replace_if(
      out.begin(), out.end(),
      [](unsigned char c) { return std::isalnum(c) == 0 && c != '-' && c != '.'; }, '_');
  return out.empty() ? "unknown" : out;
}

std::string boot_name() {
  std::string text;
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::getline(in, text);
  std::array<char, 64> space{};
  const ssize_t n = ::readlink("/proc/self/ns/pid", space.data(), space.size() - 1);
  if (n > 0) text.append(space.data(), static_cast<std::size_t>(n));
  return sha256_of(text).substr(0, 12);
}

template <typename T>
bool number(std::string_view text, T& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

// Reads field 22 of /proc/PID/stat. The second field, the program's name, may contain spaces.
std::optional<std::uint64_t> start_of(int pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/stat");
  std::string line;
  if (!std::getline(in, line)) return std::nullopt;
  const std::size_t close = line.rfind(')');
  if (close == std::string::npos) return std::nullopt;
  std::istringstream rest(line.substr(close + 1));
  std::string state, field;
  rest >> state;
  if (state == "Z" || state == "X") return std::nullopt;  // it has ended
  for (int k = 4; k <= 22; ++k)
    rest >> field;
  std::uint64_t start = 0;
  if (!rest || !number(field, start)) return std::nullopt;
  return start;
}

}  // namespace

std::string ProcessIdentity::text() const {
  return host + "." + boot + "." + std::to_string(pid) + "." + std::to_string(start);
}

ProcessIdentity this_process() {
  static const std::string host = host_name(), boot = boot_name();
  static ProcessIdentity known;
  const int pid = ::getpid();
  if (known.pid != pid) known = {host, boot, pid, start_of(pid).value_or(0)};
  return known;
}

std::optional<ProcessIdentity> identity_in(std::string_view text) {
  std::vector<std::string_view> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t dot = std::min(text.find('.', at), text.size());
    parts.push_back(text.substr(at, dot - at));
    at = dot + 1;
  }
  if (parts.size() < 5) return std::nullopt;
  const std::size_t n = parts.size();
  ProcessIdentity out;
  out.boot = parts[n - 4];
  if (!number(parts[n - 3], out.pid) || !number(parts[n - 2], out.start)) return std::nullopt;
  for (std::size_t k = 0; k + 4 < n; ++k)
    out.host.append(k == 0 ? "" : ".").append(parts[k]);
  return out;
}

Life life_of(const ProcessIdentity& process) {
  const ProcessIdentity here = this_process();
  if (process.host != here.host || process.boot != here.boot) return Life::kUnknown;
  const auto start = start_of(process.pid);
  return start && *start == process.start ? Life::kAlive : Life::kDead;
}

}  // namespace trocar::farm
