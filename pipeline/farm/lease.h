// SPDX-License-Identifier: GPL-3.0-or-later
// A lease reserves the key of an action (action_key.h) for the process that computes the action's
// outputs, so that two batches do not do the same work. Correctness does not depend on leases,
// because two processes that compute the outputs of a key write the same bytes.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "formats/base/result.h"
#include "pipeline/farm/store.h"

namespace trocar::farm {

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
