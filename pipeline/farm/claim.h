// SPDX-License-Identifier: GPL-3.0-or-later
// Who computes a key now, so that two batches do not do the same work. Correctness does not rest on
// claims: two processes that compute a key write the same bytes.
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

/// Held until it is destroyed; a thread renews its time.
class Claim {
 public:
  /// Null: another living process holds it. A claim of a dead one, or one that was not renewed for
  /// kLease, is taken over. Errors: unwritable.
  static Result<std::unique_ptr<Claim>> take(const Store& store, const std::string& key,
                                             const std::string& scan);
  Claim(const Claim&) = delete;
  Claim& operator=(const Claim&) = delete;
  ~Claim();

 private:
  explicit Claim(std::filesystem::path file);
  void renew_until_released();

  std::filesystem::path file_;
  std::mutex mutex_;
  std::condition_variable released_;
  bool is_released_ = false;
  std::thread renewer_;
};

/// Whether a living process holds the key's claim.
bool is_claimed(const Store& store, const std::string& key);

}  // namespace trocar::farm
