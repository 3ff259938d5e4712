// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nrrd/nrrd_stack.h"

#include <system_error>
#include <utility>

#include "formats/base/system_message.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nifti/nifti_stack.h"
#include "pipeline/read/nrrd/nrrd_header.h"

namespace trocar::pipeline {

namespace fs = std::filesystem;

Result<std::unique_ptr<SliceStack>> open_nrrd(const fs::path& path, const OpenOptions& options,
                                              bool header_only) {
  const std::string file = path.string();
  std::vector<Warning> warnings;
  const auto head = nrrd_head(path);
  if (!head) return head.error();
  const auto header = parse_nrrd_header(*head, file, options.volume, warnings);
  if (!header) return header.error();
  const NiftiHeader& array = header->array;
  const auto open = [&]() -> Result<VolumeFile> {
    const bool is_detached = !header->data_file.empty();
    const fs::path data = is_detached ? path.parent_path() / header->data_file : path;
    std::error_code error;
    const bool is_there = fs::is_regular_file(data, error);
    if (error && is_of_circumstances(error.value()))
      return refused_by_system(data.string(), error.value());
    if (!is_there)
      return refused(file + ": its data file " + header->data_file + " is not in its folder");
    std::int64_t from = header->data_at;
    if (header->at_end) {
      from = static_cast<std::int64_t>(fs::file_size(data, error)) - array.data_end;
      if (error || from < 0)
        return refused(data.string() + ": truncated: its header declares " +
                       std::to_string(array.data_end) + " bytes of voxels");
    }
    return VolumeFile::open_part(data, from, header->is_gzip, array.data_start, array.data_bytes(),
                                 options.unpack_behind, array.data_end);
  };
  auto stack = open_array(file, array, options, std::move(warnings),
                          header_only ? std::function<Result<VolumeFile>()>() : open);
  if (stack) (*stack)->label_names = header->label_names;
  return stack;
}

Result<std::unique_ptr<SliceStack>> open_volume(const fs::path& file, const OpenOptions& options,
                                                bool header_only) {
  auto stack = is_nrrd(file) ? open_nrrd(file, options, header_only)
                             : open_nifti(file, options, header_only);
  if (stack) (*stack)->files = files_of_volume(file);
  return stack;
}

std::vector<fs::path> files_of_volume(const fs::path& file) {
  std::vector<fs::path> out{file};
  if (auto data = nrrd_data_file(file)) out.push_back(std::move(*data));
  return out;
}

}  // namespace trocar::pipeline
