// SPDX-License-Identifier: GPL-3.0-or-later
// Limits on what a sender may send and on how long the sender may take. An instance is one DICOM
// object: usually the image of one slice, sometimes a file with many images. An association is a
// connection of the DICOM protocol.
#pragma once

#include <cstddef>
#include <cstdint>

namespace trocar::archive {

struct ArchiveLimits {
  std::uint64_t instance_bytes = std::uint64_t{512} << 20;  ///< largest size of one instance
  std::uint64_t study_bytes = std::uint64_t{16} << 30;      ///< largest total size of a study
  std::size_t study_instances = 20'000;  ///< largest number of instances in a study
  int max_pdu_bytes = 16'384;  ///< largest protocol data unit (PDU) that the sender may send
  int acse_timeout_s = 30;     ///< longest time until an association is established
  /// Longest time to receive an instance. In a fetch, the time of an instance begins when the
  /// previous instance ends; that of the first instance begins with the request.
  int dimse_timeout_s = 300;
  /// Longest wait for the next request or the next bytes. Before the first instance, fetch() waits
  /// for dimse_timeout_s if that is longer.
  int idle_timeout_s = 60;
};

}  // namespace trocar::archive
