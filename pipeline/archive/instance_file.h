// SPDX-License-Identifier: GPL-3.0-or-later
// Writes an instance (one DICOM object) that arrives from the network to a DICOM file. The bytes
// are written as they come, so that memory does not grow with the size of the instance. Only a
// complete and checked file gets its final name.
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
  kMismatch = 0xA900,        ///< not the instance that the command announced, or not an image
  kNotUnderstood = 0xC000,   ///< the dataset cannot be parsed, or lacks a valid UID
};

struct StoreOutcome {
  StoreStatus status = StoreStatus::kStored;
  std::string why = {};    ///< the reason for a refusal; contains no text of the dataset
  bool is_ours = false;    ///< true if the cause of the refusal is this computer (its disk)
  std::string study = {};  ///< the study's UID; empty if it is not known
};

struct StudySize {
  std::size_t instances = 0;
  std::uint64_t bytes = 0;
};

/// The instances of one association, in a folder of its own: FOLDER/STUDY/INSTANCE.dcm.
class InstanceStore {
 public:
  /// Precondition: the folder exists. `present` gives the size that a study has already, without
  /// the instances of this association.
  InstanceStore(std::filesystem::path folder, const ArchiveLimits& limits,
                std::function<StudySize(const std::string& study)> present = {});
  InstanceStore(const InstanceStore&) = delete;
  InstanceStore& operator=(const InstanceStore&) = delete;
  ~InstanceStore();

  /// Begins the file of an instance. Errors are reported by finish().
  void begin(const InstanceName& name);
  /// Appends bytes of the dataset. Bytes beyond the size limit, or after an error, are dropped; the
  /// dataset is still received, so that the sender gets an answer. Returns false if the sender has
  /// sent more than twice the limit.
  bool write(std::span<const std::uint8_t> bytes);
  /// Closes the file, checks it and gives it its final name. A refused instance leaves no file.
  StoreOutcome finish();

  /// Syncs all files to the disk. Errors: kUnwritable; the message names the folder.
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
