// SPDX-License-Identifier: Apache-2.0
// Space on a disk that is held free, so that the last rows and the reports of a session can be
// written when the disk is full.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "formats/base/file_descriptor.h"
#include "formats/base/result.h"

namespace trocar::runtime {

/// The space belongs to a file without a name, so nothing is left if the program is killed.
class DiskReserve {
 public:
  static constexpr std::uint64_t kBytes = std::uint64_t{1} << 20;

  /// Holds kBytes on the disk of `folder`, or nothing if its file system cannot hold space. Errors:
  /// kUnwritable if the disk has less space than that.
  static Result<DiskReserve> hold(const std::filesystem::path& folder);
  /// Gives the space back to the disk.
  void release() noexcept { file_.reset(); }

 private:
  DiskReserve() = default;
  std::optional<FileDescriptor> file_;
};

}  // namespace trocar::runtime
