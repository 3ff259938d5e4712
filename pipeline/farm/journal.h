// SPDX-License-Identifier: GPL-3.0-or-later
// The journal of a store: times and outcomes of the work on scans. Each batch writes a file of its
// own, with one line of JSON for each scan. It is for people; nothing else depends on it.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "formats/base/file_descriptor.h"

namespace trocar::farm {

class Journal {
 public:
  /// The journal's file is created when the first line is added.
  explicit Journal(std::filesystem::path folder) : folder_(std::move(folder)) {}
  /// Adds the current time and this process's host and pid to the line (as `time`, `host` and
  /// `pid`) and writes the line. Returns false if the line could not be written.
  bool add(nlohmann::json line);

 private:
  std::filesystem::path folder_;
  std::optional<FileDescriptor> fd_;
};

}  // namespace trocar::farm
