// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/open/open_stack.h"

#include <algorithm>
#include <system_error>

#include "formats/base/files.h"
#include "pipeline/open/scan_folder.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_stack.h"
#include "pipeline/read/dicom/dicom_volumes.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/image_stack.h"
#include "pipeline/read/nrrd.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

// Warns of other inputs in the folder, which are left out.
void warn_of_others(const ScanFolder& found, std::vector<Warning>& warnings) {
  const std::string others = found.left_out();
  if (others.empty()) return;
  const std::string taken = found.kind() == ScanFolder::Kind::kDicom ? "DICOM slices are taken"
                            : found.kind() == ScanFolder::Kind::kVolume
                                ? "the " + format_of_volumes(found.volumes) + " file is taken"
                                : "its own images are taken";
  const auto said = [taken](const std::string& left_out) {
    return taken + "; left out: " + left_out + ", which can be given by their own names";
  };
  warnings.push_back({"other_input", found.where, said(others), said(found.left_out(false))});
}

Result<std::unique_ptr<SliceStack>> open_volume_file(const fs::path& file,
                                                     const OpenOptions& options) {
  if (auto ok = check_readable(file); !ok) return ok.error();
  if (!options.series.empty())
    return usage(file.string() + ": --series chooses among DICOM files; there are none");
  return open_volume(file, options);
}

Result<std::unique_ptr<SliceStack>> open_image_files(const std::vector<fs::path>& files,
                                                     const std::string& where,
                                                     const OpenOptions& options) {
  if (options.axis.value_or(SliceAxis::kAxial) != SliceAxis::kAxial)
    return usage(where + ": --axis applies to volumes only; images keep their planes");
  if (!options.series.empty())
    return usage(where + ": --series chooses among DICOM files; there are none");
  if (auto ok = check_no_volume(where, options.volume); !ok) return ok.error();
  for (const fs::path& file : files) {
    if (auto ok = check_readable(file); !ok) return ok.error();
  }
  auto stack = open_images(files, options);
  if (stack) (*stack)->files = files;
  return stack;
}

Result<std::unique_ptr<SliceStack>> open_folder(const fs::path& folder,
                                                const OpenOptions& options) {
  std::vector<Warning> warnings;
  auto found = search_folder(folder, DicomExtent::kWhole, options, warnings);
  if (!found) return found.error();
  warn_of_others(*found, warnings);
  Result<std::unique_ptr<SliceStack>> stack = bug("no reader");
  switch (found->kind()) {
    case ScanFolder::Kind::kVolume:
      if (found->volumes.size() > 1)
        return choose_one(found->where, format_of_volumes(found->volumes) + " files",
                          found->volumes);
      stack = open_volume_file(found->volumes[0], options);
      break;
    case ScanFolder::Kind::kImages:
      if (!found->has_own_images() && found->images.size() > 1) {
        std::vector<fs::path> parents;
        for (const auto& files : found->images)
          parents.push_back(files[0].parent_path());
        return choose_one(found->where, "folders of images", parents);
      }
      stack = open_image_files(found->images[0], folder.string(), options);
      break;
    case ScanFolder::Kind::kDicom:
    case ScanFolder::Kind::kNothing:
      stack = open_dicom(std::move(found->dicom), found->where, options);
      break;
  }
  if (stack) {
    std::vector<Warning>& all = (*stack)->warnings;
    all.insert(all.begin(), warnings.begin(), warnings.end());
  }
  return stack;
}

Result<std::unique_ptr<SliceStack>> open_files(std::vector<fs::path> files,
                                               const OpenOptions& options) {
  const std::string first = files[0].string();
  std::sort(files.begin(), files.end(), natural_less);
  if (files.size() == 1 && is_volume(files[0])) return open_volume_file(files[0], options);
  if (std::any_of(files.begin(), files.end(), is_volume))
    return usage(first + ": give one NIfTI or NRRD file, not a list with one in it");
  if (std::any_of(files.begin(), files.end(), is_image))
    return open_image_files(files, first, options);
  for (const fs::path& file : files) {
    if (auto ok = check_readable(file); !ok) return ok.error();
  }
  return open_dicom(files, options);
}

Result<std::unique_ptr<SliceStack>> open_ct(const std::filesystem::path& ct,
                                            std::optional<SliceAxis> axis) {
  OpenOptions options;
  options.axis = axis;
  auto stack = open_stack({ct}, options);
  if (!stack) {
    // If the input can be opened with these options, it consists of images or is of another
    // modality. The error is then that it has no HU.
    options.spacing_mm = {1, 1, 1};
    options.any_modality = true;
    options.axis.reset();
    const auto other = open_stack({ct}, options);
    if (!other || (*other)->pixel_unit() == PixelUnit::kHounsfield) return stack;
    const std::string& modality = (*other)->modality;
    return refused(ct.string() + ": its values are not HU" +
                   (modality.empty() ? " (images)" : " (" + modality + ")") +
                   "; --hu takes the CT that the labels were made on");
  }
  if ((*stack)->pixel_unit() != PixelUnit::kHounsfield)
    return bug(ct.string() + ": a scan without HU was taken");
  return stack;
}

}  // namespace

bool is_scan_file(const fs::path& file) {
  return is_image(file) || is_volume(file) || has_dicom_preamble(file);
}

Result<std::unique_ptr<SliceStack>> open_stack(const std::vector<fs::path>& inputs,
                                               const OpenOptions& options) {
  if (inputs.empty()) return usage("no input given");
  std::error_code error;
  for (const fs::path& input : inputs) {
    const fs::file_status status = fs::status(input, error);
    if (error && is_of_circumstances(error.value()))
      return refused_by_system(input.string(), error.value());
    if (!fs::exists(status)) return refused(input.string() + ": no such file or folder");
    if (fs::is_directory(status)) {
      if (inputs.size() > 1) return usage(input.string() + ": give one folder, or a list of files");
      return open_folder(input, options);
    }
    if (!fs::is_regular_file(status)) return refused(input.string() + ": not a regular file");
  }
  if (inputs.size() == 1) {
    if (const auto folder = folder_of_dicomdir(inputs[0])) return open_folder(*folder, options);
  }
  return open_files(inputs, options);
}

Result<LabelsWithCt> open_labels_with_ct(const std::vector<std::filesystem::path>& inputs,
                                         const std::filesystem::path& ct,
                                         const OpenOptions& options) {
  auto stored = open_ct(ct, {});
  if (!stored) return stored.error();
  OpenOptions of_labels = options;
  of_labels.segmented_ct = stored->get();
  auto labels = open_stack(inputs, of_labels);
  if (!labels) return labels.error();
  if (options.axis) {
    stored = open_ct(ct, options.axis);
    if (!stored) return stored.error();
  }
  LabelsWithCt out{std::move(*labels), std::move(*stored)};
  if (const auto differs = grid_difference(*out.labels, *out.ct)) {
    const std::string where =
        differs->slice < 0 ? inputs[0].string() : out.labels->name(differs->slice);
    return refused(where + ": is not on the grid of the CT " + ct.string() + ": its " +
                   differs->what +
                   "; --hu takes the CT that the labels were made on, nothing is resampled");
  }
  out.labels->warnings.insert(out.labels->warnings.end(), out.ct->warnings.begin(),
                              out.ct->warnings.end());
  return out;
}

}  // namespace trocar::pipeline
