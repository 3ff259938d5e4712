// SPDX-License-Identifier: GPL-3.0-or-later
// Writes an instance (one DICOM object) that arrives from the network to a DICOM file. Bytes are
// written as they arrive, so that memory does not grow with the size of the instance. The file gets
// its final name only when it is complete and checked.
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

/// UIDs with which the sender announces an instance: `sop_class` is the kind of the instance,
/// `sop_instance` its own UID, and `transfer_syntax` the encoding of its bytes. The texts come from
/// the network and are not checked yet.
struct InstanceName {
  std::string sop_class, sop_instance, transfer_syntax;
};

/// The status in the answer to a C-STORE request (DICOM PS3.4, table B.2-1). Every status except
/// kStored refuses the instance.
enum class StoreStatus : std::uint16_t {
  kStored = 0x0000,
  kDuplicate = 0x0111,       ///< this association has sent other bytes with the same instance UID
  kOutOfResources = 0xA700,  ///< a limit is exceeded, or the file cannot be written
  /// The UIDs in the dataset differ from those in the request, trocar-mesh does not read this kind
  /// of instance, or the dataset has no pixels.
  kMismatch = 0xA900,
  kNotUnderstood = 0xC000,  ///< the dataset is missing or damaged, or lacks a valid UID
};

struct StoreOutcome {
  StoreStatus status = StoreStatus::kStored;
  std::string why = {};    ///< the reason for a refusal; contains no text of the dataset
  bool is_ours = false;    ///< true: the disk of this computer, not the sender, is the cause
  std::string study = {};  ///< the study's UID; empty if the UIDs are not valid or not read
};

struct StudySize {
  std::size_t instances = 0;
  std::uint64_t bytes = 0;
};

/// Stores the instances of one association as FOLDER/STUDY_UID/INSTANCE_UID.dcm. For each instance,
/// call begin(), then write() for each fragment of the dataset, then finish().
class InstanceStore {
 public:
  /// Is a file with this name and size, an instance of this study, stored outside the folder of the
  /// InstanceStore?
  using IsStored =
      std::function<bool(const std::string& study, const std::string& name, std::uint64_t bytes)>;

  /// Precondition: `folder` exists and no other association uses it. `present` returns the size of
  /// the instances of a study that are stored outside `folder`. Those instances count too, because
  /// the limits apply to the whole study. Without `present`, only the instances in `folder` count.
  /// If `is_stored` returns true for an instance that arrives, the instance is one of those that
  /// `present` counts, and is not counted again.
  InstanceStore(std::filesystem::path folder, const ArchiveLimits& limits,
                std::function<StudySize(const std::string& study)> present = {},
                IsStored is_stored = {});
  InstanceStore(const InstanceStore&) = delete;
  InstanceStore& operator=(const InstanceStore&) = delete;
  ~InstanceStore();

  /// Begins the file of an instance. Errors are reported by finish().
  void begin(const InstanceName& name);
  /// Appends bytes of the dataset. If a write fails, or if the dataset is larger than
  /// `instance_bytes` of `limits`, the further bytes are dropped and finish() refuses the instance.
  /// Returns false only if more than twice `instance_bytes` have arrived; the caller must then
  /// abort the association.
  bool write(std::span<const std::uint8_t> bytes);
  /// Closes the file and checks it. If the instance is accepted, its file gets its final name;
  /// otherwise the file is removed. If this association has already stored an instance with the
  /// same UID and the same bytes, the new file is removed too, but the outcome is kStored.
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
  IsStored is_stored_;
  std::map<std::string, StudySize> sizes_;
  InstanceName name_;
  int fd_ = -1;
  int error_ = 0;              // errno of the first failed step
  std::uint64_t arrived_ = 0;  // bytes of the dataset that have arrived, also those not written
};

/// The start of a file, before the dataset: preamble and meta information (DICOM PS3.10, 7.1).
std::string file_header(const InstanceName& name);

}  // namespace trocar::archive
