// SPDX-License-Identifier: GPL-3.0-or-later
// Identifies the process that made a temporary file or holds a lease, and finds out whether this
// process is still alive.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace trocar::farm {

struct ProcessIdentity {
  std::string host;
  /// Identifies one start of the system and, in it, one process namespace (for example that of a
  /// container). The text is the first 12 digits of a digest of the kernel's boot id and the
  /// namespace's name. At any time, no two processes with the same `boot` have the same `pid`.
  std::string boot;
  int pid = 0;
  std::uint64_t start = 0;  ///< start of the process, in kernel ticks since the boot

  bool operator==(const ProcessIdentity&) const = default;
  /// "HOST.BOOT.PID.START", without slashes.
  std::string text() const;
};

/// The identity of this process. After fork(), the new process gets an identity of its own.
ProcessIdentity this_process();

/// Reads the identity from a text of the form HOST.BOOT.PID.START.REST, such as the name of a
/// temporary file. Only HOST may contain dots. Returns no value if the text does not have this
/// form.
std::optional<ProcessIdentity> identity_in(std::string_view text);

enum class Life { kAlive, kDead, kUnknown };
/// Is the process alive? kUnknown if it belongs to another host, boot or namespace.
Life life_of(const ProcessIdentity& process);

}  // namespace trocar::farm
