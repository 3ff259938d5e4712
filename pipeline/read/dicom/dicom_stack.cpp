// SPDX-License-Identifier: GPL-3.0-or-later
// The headers are read first (dicom_headers). Then the series is chosen and its slices are ordered
// (dicom_series). Pixels are decoded when a slice is read (dicom_pixels).
#include "pipeline/read/dicom/dicom_stack.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <set>

#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_lossy.h"
#include "pipeline/read/dicom/dicom_parsed_files.h"
#include "pipeline/read/dicom/dicom_pixels.h"
#include "pipeline/read/dicom/dicom_segmentation.h"
#include "pipeline/read/dicom/dicom_series.h"
#include "pipeline/read/dicom/dicom_volumes.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/label_values.h"
#include "pipeline/read/nifti/resliced_stack.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {
namespace {

class DicomStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(slices_.size()); }
  int width() const override { return slices_[0].columns; }
  int height() const override { return slices_[0].rows; }
  PixelUnit pixel_unit() const override {
    return modality.empty() ? PixelUnit::kHounsfield : PixelUnit::kUncalibrated;
  }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return slices_[slice].name(); }

  Result<Image> read(int slice) const override {
    const DicomFrame& h = slices_[slice];
    auto format = parsed_.take(h);
    if (!format) return format.error();
    auto image = read_dicom_frame(h, **format);
    parsed_.give_back(h, std::move(*format));
    return image;
  }
  Result<LabelImage> read_labels(int slice) const override {
    const auto image = read(slice);
    if (!image) return image.error();
    return to_labels(*image, name(slice), kNoData_HU);  // padding is background
  }

  std::vector<DicomFrame> slices_;
  std::vector<SlicePlane> planes_;
  mutable ParsedFiles parsed_;
};

// The warning about the use of --spacing, of which z can be the distance between frames.
Warning use_of_spacing(const std::vector<DicomFrame>& slices, bool for_frames,
                       const std::string& where) {
  const auto without = std::count_if(slices.begin(), slices.end(),
                                     [](const DicomFrame& h) { return !h.has_spacing; });
  if (without == 0 && for_frames) {
    return {"spacing_ignored", where,
            "X and Y of --spacing are for input without a pixel size; the files' own is used"};
  }
  if (without == 0) {
    return {"spacing_ignored", where,
            "--spacing is for input without a pixel size; the files' own is used"};
  }
  return {"no_pixel_spacing", where,
          std::to_string(without) + " slices have no pixel spacing; X and Y of --spacing are used" +
              (for_frames ? "" : ", and the files' own positions")};
}

// Warns of frames that are placed by one position. Returns true if --spacing gives their distance.
bool warn_of_placement(const std::vector<DicomFile>& files,
                       const std::set<std::filesystem::path>& used,
                       std::vector<Warning>& warnings) {
  bool has_given_step = false;
  for (const DicomFile& file : files) {
    if (file.placement.empty() || !used.contains(file.file)) continue;
    warnings.push_back({"assumed_direction", file.file.string(), file.placement});
    has_given_step = has_given_step || file.has_given_step;
  }
  return has_given_step;
}

Error no_dicom(const std::vector<DicomFile>& files, const std::string& where) {
  if (files.size() == 1) {
    return refused(files[0].file.string() +
                   ": not a DICOM image, and its name is not that of a NIfTI (.nii, .nii.gz), NRRD "
                   "(.nrrd, .nhdr) or image (.png, .tif, .bmp, .jpg)");
  }
  return refused(where + ": contains no DICOM images (" + files[0].file.filename().string() +
                 " is not one)");
}

// The segmentation to use if labels are wanted: that of the series, or the only one; null if there
// is none. Errors: (usage) several.
Result<const DicomFile*> chosen_segmentation(const std::vector<DicomFile>& headers,
                                             const std::string& uid, const std::string& where) {
  const DicomFile* last = nullptr;
  std::vector<std::filesystem::path> files;
  for (const DicomFile& file : headers) {
    const bool is_meant = uid.empty() || file.series.uid == uid;
    if (!file.content.is_segmentation() || !is_meant) continue;
    last = &file;
    files.push_back(file.file);
  }
  if (files.size() > 1) return choose_one(where, "segmentations", files);
  return last;
}

Result<std::unique_ptr<SliceStack>> open_labels(const DicomFile& file,
                                                const std::vector<DicomFile>& headers,
                                                const std::string& where,
                                                const OpenOptions& options) {
  if (file.kind != DicomFile::Kind::kSegmentation) return refused(file.problem);
  auto stack = open_segmentation(file, options);
  if (stack) warn_of_lossy(headers, {file.file}, (*stack)->warnings);
  const auto others = std::count_if(headers.begin(), headers.end(), [](const DicomFile& other) {
    return other.kind != DicomFile::Kind::kNotImage;
  });
  if (stack && others > 1) {
    (*stack)->warnings.push_back({"other_series", where,
                                  "the segmentation " + file.file.filename().string() +
                                      " is taken for --labels; left out: " +
                                      std::to_string(others - 1) + " other DICOM files"});
  }
  return stack;
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_dicom(const std::vector<std::filesystem::path>& files,
                                               const OpenOptions& options) {
  const std::filesystem::path folder = files[0].parent_path();
  const std::string where = ((folder.empty() ? "." : folder) / "").string();
  std::vector<DicomFile> headers;
  headers.reserve(files.size());
  for (const std::filesystem::path& file : files)
    headers.push_back(read_dicom_headers(file, options.spacing_mm, options.any_modality));
  return open_dicom(std::move(headers), where, options);
}

Result<std::unique_ptr<SliceStack>> open_dicom(std::vector<DicomFile> headers,
                                               const std::string& where,
                                               const OpenOptions& options) {
  auto stack = std::make_unique<DicomStack>();
  std::vector<Warning> ignored;
  const auto before = group_series(headers, ignored);
  if (before.empty()) return no_dicom(headers, where);
  std::string uid;
  if (!options.series.empty()) {
    const auto wanted = named_series(before, options.series);
    if (!wanted) return wanted.error();
    uid = *wanted;
  }
  if (options.as_labels) {
    const auto labels = chosen_segmentation(headers, uid, where);
    if (!labels) return labels.error();
    if (*labels != nullptr) {
      if (auto ok = check_no_volume(where, options.volume); !ok) return ok.error();
      return open_labels(**labels, headers, where, options);
    }
  }
  if (auto ok = settle_localisers(headers, uid, options.any_modality); !ok) return ok.error();
  const auto series = group_series(headers, stack->warnings);
  const auto chosen = choose_series(series, uid, where);
  if (!chosen) return chosen.error();
  auto slices = slices_of(series, *chosen, where, stack->warnings);
  if (!slices) return slices.error();
  stack->series = series[chosen->index].info;
  const auto with_advice = [&](const Error& error) {
    return Error{error.code,
                 error.message + (chosen->why.empty() ? "" : "; --series chooses another series")};
  };
  auto volumes = volumes_of(std::move(*slices), stack->warnings);
  if (!volumes) return with_advice(volumes.error());
  const auto volume = chosen_volume(*volumes, options.volume, where);
  if (!volume) return with_advice(volume.error());
  stack->slices_ = std::move((*volumes)[*volume].slices);
  warn_of_volume(stack->slices_, stack->warnings);
  std::set<std::filesystem::path> used;
  for (const DicomFrame& h : stack->slices_)
    used.insert(h.file);
  const bool has_given_step = warn_of_placement(headers, used, stack->warnings);
  if (options.spacing_mm)
    stack->warnings.push_back(use_of_spacing(stack->slices_, has_given_step, where));
  warn_of_lossy(headers, used, stack->warnings);
  stack->modality = other_modality(headers, used, stack->warnings);
  for (const DicomFile& file : headers) {
    if (used.count(file.file) > 0) stack->files.push_back(file.file);
  }
  const Eigen::Vector3d normal = stack->slices_[0].u.cross(stack->slices_[0].v);
  for (const DicomFrame& h : stack->slices_) {
    stack->planes_.push_back(plane_of(h, h.position));
    stack->planes_.back().z_mm = normal.dot(h.position);
  }
  if (options.axis) return resliced(std::move(stack), *options.axis, where, options.as_labels);
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
