// SPDX-License-Identifier: GPL-3.0-or-later
// One instance that arrives from the network, as a DICOM file. Its bytes are written as they come,
// so that memory does not grow with its size. Only a complete and checked file gets its name.
// Tests: tests/pipeline/archive/instance_file_test.cpp
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <span>
#include <string>

#include "formats/base/result.h"
#include "pipeline/archive/archive_limits.h"

namespace trocar::archive {

/// How the sender names an instance. The texts come from the network and are not checked yet.
struct InstanceName {
  std::string sop_class, sop_instance, transfer_syntax;
};

/// The status of the answer to a C-STORE (DICOM PS3.4, table B.2-1).
enum class StoreStatus : std::uint16_t {
  kStored = 0x0000,
  kDuplicate = 0x0111,       ///< another instance with the same UID has arrived before
  kOutOfResources = 0xA700,  ///< a limit is exceeded, or the disk is full
  kMismatch = 0xA900,        ///< the dataset is not the one that the command announced
  kNotUnderstood = 0xC000,   ///< the dataset cannot be parsed, or lacks what every image has
};

struct StoreOutcome {
  StoreStatus status = StoreStatus::kStored;
  std::string why = {};    ///< the reason of a refusal, without any text of the dataset
  bool is_ours = false;    ///< true: the refusal is due to this computer (the disk)
  std::string study = {};  ///< the study's UID; empty if it is not known
};

struct StudySize {
  std::size_t instances = 0;
  std::uint64_t bytes = 0;
};

/// The instances of one association, in a folder of its own: FOLDER/STUDY/INSTANCE.dcm.
class InstanceStore {
 public:
  /// The folder must exist. `present` gives the size of what is stored of a study so far.
  InstanceStore(std::filesystem::path folder, const ArchiveLimits& limits,
                std::function<StudySize(const std::string& study)> present = {});
  InstanceStore(const InstanceStore&) = delete;
  InstanceStore& operator=(const InstanceStore&) = delete;
  ~InstanceStore();

  /// Begins the file of an instance. Errors are reported by finish().
  void begin(const InstanceName& name);
  /// Adds bytes of the dataset. Bytes beyond the limit, or after an error, are dropped, so that the
  /// sender gets an answer. Returns false if it sends more than twice the limit.
  bool write(std::span<const std::uint8_t> bytes);
  /// Ends the file, checks it and gives it its name. If it is refused, nothing of it is left.
  StoreOutcome finish();

  /// Syncs all files to the disk. Errors (unwritable): names the folder.
  Result<void> sync() const;

 private:
  StoreOutcome check(std::uint64_t bytes, std::string& study) const;
  StoreOutcome accept(std::uint64_t bytes, const std::string& study);
  void give_up();

  std::filesystem::path folder_, part_;
  ArchiveLimits limits_;
  std::function<StudySize(const std::string&)> present_;
  std::map<std::string, StudySize> sizes_;
  InstanceName name_;
  int fd_ = -1;
  int error_ = 0;              // errno of the first failed step
  std::uint64_t arrived_ = 0;  // bytes of the dataset, written or not
};

/// The preamble and the file meta information (DICOM PS3.10, 7.1) of a file.
std::string file_header(const InstanceName& name);

}  // namespace trocar::archive
