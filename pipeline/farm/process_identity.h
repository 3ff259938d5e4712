// SPDX-License-Identifier: GPL-3.0-or-later
// The identity of the process that made a temporary file or holds a lease, and whether it is alive.
// Tests: tests/pipeline/farm/store_test.cpp
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace trocar::farm {

struct ProcessIdentity {
  std::string host;
  /// First 12 digits of a digest of the boot and the process namespace, within which process
  /// numbers are unique.
  std::string boot;
  int pid = 0;
  std::uint64_t start = 0;  ///< start of the process, in kernel ticks since the boot

  bool operator==(const ProcessIdentity&) const = default;
  /// "HOST.BOOT.PID.START", without slashes.
  std::string text() const;
};

/// The identity of this process, also directly after fork().
ProcessIdentity this_process();

/// The identity at the beginning of a text, if a dot follows it. Host names may contain dots.
std::optional<ProcessIdentity> identity_in(std::string_view text);

enum class Life { kAlive, kDead, kUnknown };
/// Whether the process is alive; kUnknown for another host, boot or namespace.
Life life_of(const ProcessIdentity& process);

}  // namespace trocar::farm
