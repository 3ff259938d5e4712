// SPDX-License-Identifier: GPL-3.0-or-later
// Which process made a temporary file or a claim, and whether it still lives.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace trocar::farm {

struct Owner {
  std::string host;
  /// Of the boot and the process namespace: the first 12 digits of a digest. Process numbers mean
  /// something within these only.
  std::string boot;
  int pid = 0;
  std::uint64_t start = 0;  ///< of the process, in the kernel's ticks since the boot

  bool operator==(const Owner&) const = default;
  /// "HOST.BOOT.PID.START", without slashes.
  std::string text() const;
};

/// This process; also right after fork().
Owner this_process();

/// The owner in a text that begins with Owner::text() and a dot. Of a host's name with dots, too.
std::optional<Owner> owner_of(std::string_view text);

enum class Life { kAlive, kDead, kUnknown };
/// kUnknown: another host, boot or namespace.
Life life_of(const Owner& owner);

}  // namespace trocar::farm
