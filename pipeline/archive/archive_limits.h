// SPDX-License-Identifier: GPL-3.0-or-later
// How much a sender may send, and how long it may take.
// Tests: tests/e2e/archive_test.py
#pragma once

#include <cstddef>
#include <cstdint>

namespace trocar::archive {

struct ArchiveLimits {
  std::uint64_t instance_bytes = std::uint64_t{512} << 20;  ///< size of one instance
  std::uint64_t study_bytes = std::uint64_t{16} << 30;      ///< sum of a study's instances
  std::size_t study_instances = 20'000;
  int max_pdu_bytes = 16'384;  ///< the largest PDU that the sender may send
  int acse_timeout_s = 30;     ///< time until an association is established
  int dimse_timeout_s = 300;   ///< time to receive one instance
  int idle_timeout_s = 60;     ///< time without a request
};

}  // namespace trocar::archive
