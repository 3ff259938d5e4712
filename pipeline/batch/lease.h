// SPDX-License-Identifier: GPL-3.0-or-later
// Identifies the process that made a temporary file or holds a lease, and finds out whether this
// process is still alive.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>

#include "formats/base/result.h"
#include "pipeline/batch/store.h"

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

// A lease reserves the key of an action (scan_files.h) for the process that computes the action's
// outputs, so that two batches do not do the same work. Correctness does not depend on leases,
// because two processes that compute the outputs of a key write the same bytes.

/// A lease that this process holds until the object is destroyed. A thread renews the lease.
class Lease {
 public:
  /// Takes the lease of the key. If a process holds a valid lease of the key already, the result is
  /// null. A lease is no longer valid if its process is dead. If it is unknown whether the process
  /// is alive, the lease is valid for kLeaseDuration (store.h) after its last renewal. The file of
  /// the lease contains the scan's name, for people who look into the file. Errors: kUnwritable if
  /// the lease cannot be written.
  static Result<std::unique_ptr<Lease>> take(const Store& store, const std::string& key,
                                             const std::string& scan);
  Lease(const Lease&) = delete;
  Lease& operator=(const Lease&) = delete;
  ~Lease();

 private:
  explicit Lease(std::filesystem::path file);
  void renew_until_released();

  std::filesystem::path file_;
  std::mutex mutex_;
  std::condition_variable released_;
  bool is_released_ = false;
  std::thread renewer_;
};

/// Does any process hold a valid lease of the key?
bool is_leased(const Store& store, const std::string& key);

}  // namespace trocar::farm
