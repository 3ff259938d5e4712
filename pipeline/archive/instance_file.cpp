// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/instance_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>
#include <utility>

#include "formats/base/file_descriptor.h"
#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/storage_classes.h"
#include "pipeline/farm/atomic_file.h"
#include "pipeline/farm/scan_files.h"
#include "pipeline/farm/sha256.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::archive {
namespace {

namespace fs = std::filesystem;

// An element with explicit representation and little endian. UIDs are padded by a zero byte.
void append(std::string& out, std::uint16_t element, const char* representation,
            std::string value) {
  if (value.size() % 2 != 0) value.push_back('\0');
  const auto u16 = [&out](std::size_t n) {
    out.push_back(static_cast<char>(n & 0xff));
    out.push_back(static_cast<char>(n >> 8 & 0xff));
  };
  u16(2);
  u16(element);
  out += representation;
  if (std::strcmp(representation, "OB") == 0) {
    u16(0);
    u16(value.size());
    u16(0);
  } else {
    u16(value.size());
  }
  out += value;
}

StoreOutcome disk_refusal(int error) {
  return {StoreStatus::kOutOfResources,
          std::string("cannot be written: ") + std::generic_category().message(error), true};
}

}  // namespace

std::string file_header(const InstanceName& name) {
  std::string elements;
  append(elements, 0x0001, "OB", std::string("\0\1", 2));
  append(elements, 0x0002, "UI", name.sop_class);
  append(elements, 0x0003, "UI", name.sop_instance);
  append(elements, 0x0010, "UI", name.transfer_syntax);
  // A UID made from a UUID (PS3.5, B.2), which stands for this program.
  append(elements, 0x0012, "UI", "2.25.112706284178632943310924171932475221577");
  append(elements, 0x0013, "SH", "TROCAR");
  std::string length(4, '\0');
  for (std::size_t k = 0; k < 4; ++k)
    length[k] = static_cast<char>(elements.size() >> (8 * k) & 0xff);
  std::string out(128, '\0');
  out += "DICM";
  append(out, 0x0000, "UL", length);
  return out + elements;
}

InstanceStore::InstanceStore(fs::path folder, const ArchiveLimits& limits,
                             std::function<StudySize(const std::string&)> present,
                             IsStored is_stored)
    : folder_(std::move(folder)),
      part_(folder_ / "arriving.part"),
      limits_(limits),
      present_(std::move(present)),
      is_stored_(std::move(is_stored)) {
  pipeline::set_up_dcmtk();
}

InstanceStore::~InstanceStore() {
  give_up();
}

void InstanceStore::give_up() {
  if (fd_ < 0) return;
  ::close(fd_);
  fd_ = -1;
  ::unlink(part_.c_str());
}

void InstanceStore::begin(const InstanceName& name) {
  give_up();
  name_ = name;
  arrived_ = 0;
  error_ = 0;
  fd_ = ::open(part_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd_ < 0) {
    error_ = errno;
    return;
  }
  const std::string header = file_header(name);
  if (!farm::write_all(fd_, header)) error_ = errno;
}

bool InstanceStore::write(std::span<const std::uint8_t> bytes) {
  arrived_ += bytes.size();
  if (error_ == 0 && arrived_ <= limits_.instance_bytes && !farm::write_all(fd_, bytes))
    error_ = errno;
  return arrived_ <= 2 * limits_.instance_bytes;
}

StoreOutcome InstanceStore::finish() {
  if (fd_ >= 0 && ::close(std::exchange(fd_, -1)) != 0 && error_ == 0) error_ = errno;
  std::string study;
  StoreOutcome out = check(arrived_, study);
  if (out.status == StoreStatus::kStored) out = accept(arrived_, study);
  if (out.status != StoreStatus::kStored) ::unlink(part_.c_str());
  out.study = study;
  return out;
}

// Is the file what the sender announced, and an image? Gives the study's UID if it is valid.
StoreOutcome InstanceStore::check(std::uint64_t bytes, std::string& study) const {
  if (bytes > limits_.instance_bytes)
    return {StoreStatus::kOutOfResources, "larger than --max-instance-mb"};
  if (error_ != 0) return disk_refusal(error_);
  if (!is_uid(name_.sop_instance))
    return {StoreStatus::kNotUnderstood, "its SOP Instance UID is not a UID"};
  if (!is_storage_class(name_.sop_class))
    return {StoreStatus::kMismatch, "its SOP class is not one that trocar-mesh reads"};
  DcmFileFormat format;
  if (pipeline::load_dicom(part_, format).bad())
    return {StoreStatus::kNotUnderstood, "it is damaged or truncated"};
  DcmDataset& data = *format.getDataset();
  if (pipeline::dicom_text(&data, DCM_SOPClassUID) != name_.sop_class ||
      pipeline::dicom_text(&data, DCM_SOPInstanceUID) != name_.sop_instance)
    return {StoreStatus::kMismatch, "its UIDs differ from those of the command"};
  const std::string uid = pipeline::dicom_text(&data, DCM_StudyInstanceUID);
  if (!is_uid(uid) || !is_uid(pipeline::dicom_text(&data, DCM_SeriesInstanceUID)))
    return {StoreStatus::kNotUnderstood, "it has no valid UIDs of study and series"};
  study = uid;
  if (pipeline::dicom_integer(&data, DCM_Rows, 0) == 0 ||
      pipeline::dicom_integer(&data, DCM_Columns, 0) == 0 ||
      pipeline::dicom_pixel_data(format) == nullptr)
    return {StoreStatus::kMismatch, "it has no pixels"};
  return {};
}

// Gives the checked file its name, unless the study has reached a limit.
StoreOutcome InstanceStore::accept(std::uint64_t bytes, const std::string& study) {
  const fs::path target = folder_ / study / (name_.sop_instance + ".dcm");
  std::error_code ignored;
  if (fs::exists(target, ignored)) {
    if (!farm::same_sha256(part_, target))
      return {StoreStatus::kDuplicate, "another instance with its UID has arrived before"};
    ::unlink(part_.c_str());
    return {};
  }
  const auto [at, is_new] = sizes_.try_emplace(study);
  StudySize& size = at->second;
  if (is_new && present_) size = present_(study);
  const bool is_stored =
      is_stored_ && is_stored_(study, target.filename().string(), fs::file_size(part_, ignored));
  if (!is_stored && size.instances + 1 > limits_.study_instances)
    return {StoreStatus::kOutOfResources, "the study has --max-instances already"};
  if (!is_stored && size.bytes + bytes > limits_.study_bytes)
    return {StoreStatus::kOutOfResources, "the study is larger than --max-study-gb"};
  if ((::mkdir(target.parent_path().c_str(), 0700) != 0 && errno != EEXIST) ||
      ::rename(part_.c_str(), target.c_str()) != 0)
    return disk_refusal(errno);
  if (is_stored) return {};
  size.instances += 1;
  size.bytes += bytes;
  return {};
}

Result<void> InstanceStore::sync() const {
  std::error_code error;
  for (fs::recursive_directory_iterator at(folder_, error), end; !error && at != end;
       at.increment(error)) {
    const FileDescriptor fd(::open(at->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    if (fd.get() < 0 || ::fsync(fd.get()) != 0) return farm::cannot_write(folder_, errno);
  }
  if (error) return farm::cannot_write(folder_, error.value());
  return farm::sync_folder(folder_);
}

}  // namespace trocar::archive
