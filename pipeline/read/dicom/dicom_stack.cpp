// SPDX-License-Identifier: GPL-3.0-or-later
// The headers are read first (dicom_headers). Then the series is chosen and its slices are ordered
// (dicom_series). Pixels are decoded when a slice is read (dicom_pixels).
#include "pipeline/read/dicom/dicom_stack.h"

#include <algorithm>

#include "pipeline/read/dicom/dicom_lossy.h"
#include "pipeline/read/dicom/dicom_parse.h"
#include "pipeline/read/dicom/dicom_pixels.h"
#include "pipeline/read/dicom/dicom_series.h"
#include "pipeline/read/dicom/dicom_volumes.h"
#include "pipeline/read/file_names.h"
#include "pipeline/read/nifti.h"
#include "pipeline/read/number_ranges.h"

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

constexpr int kMaxSlices = 1 << 15;

std::string segment_text(const DicomSegments& segments, int number) {
  const auto found = segments.names.find(number);
  const bool has_name = found != segments.names.end() && !found->second.empty();
  return std::to_string(number) + (has_name ? " (" + found->second + ")" : "");
}

// The frames of a slice, each of another segment.
using SliceFrames = std::vector<DicomFrame>;

// A segmentation (PS3.3, A.51) has one frame for each segment and slice, in any order. Frames
// without a pixel of the segment are often missing.
class SegmentationStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(planes_.size()); }
  int width() const override { return file_.frames[0].columns; }
  int height() const override { return file_.frames[0].rows; }
  // The unit is that of a NIfTI label map, and of this segmentation along another axis.
  PixelUnit pixel_unit() const override { return PixelUnit::kHounsfield; }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override {
    return file_.file.string() + " slice " + std::to_string(slice);
  }

  Result<Image> read(int slice) const override {
    const auto labels = read_labels(slice);
    if (!labels) return labels.error();
    return Image{width(), height(), {labels->values.begin(), labels->values.end()}};
  }

  Result<LabelImage> read_labels(int slice) const override {
    LabelImage out{width(), height(), {}};
    out.values.assign(static_cast<std::size_t>(out.width) * out.height, 0);
    const SliceFrames& frames = frames_[static_cast<std::size_t>(slice)];
    if (frames.empty()) return out;
    auto format = parsed_.take(frames[0]);
    if (!format) return format.error();
    // Wanted segments are written last, so overlaps with other segments do not matter.
    Result<void> done;
    for (const bool wanted : {false, true}) {
      for (const DicomFrame& frame : frames) {
        if (done && is_wanted(frame.segment) == wanted) done = add(frame, slice, **format, out);
      }
    }
    parsed_.give_back(frames[0], std::move(*format));
    if (!done) return done.error();
    return out;
  }

  bool is_wanted(int segment) const { return wanted_.empty() || wanted_.contains(segment); }

  Result<void> add(const DicomFrame& frame, int slice, DcmFileFormat& format,
                   LabelImage& out) const {
    const auto inside = pixels(frame, format);
    if (!inside) return inside.error();
    for (const std::size_t i : *inside) {
      const int before = out.values[i];
      if (before != 0 && is_wanted(before) && is_wanted(frame.segment)) {
        const auto width = static_cast<std::size_t>(out.width);
        return refused(name(slice) + ": the segments " + segment_text(file_.segments, before) +
                       " and " + segment_text(file_.segments, frame.segment) +
                       " overlap, first in pixel " + std::to_string(i % width) + ", " +
                       std::to_string(i / width) + "; give one of them with --labels");
      }
      out.values[i] = frame.segment;
    }
    return {};
  }

  // The pixels in the segment: those whose bit is set, or whose fraction is at least half of the
  // largest one.
  Result<std::vector<std::size_t>> pixels(const DicomFrame& frame, DcmFileFormat& format) const {
    const std::size_t count = static_cast<std::size_t>(frame.rows) * frame.columns;
    std::vector<std::size_t> out;
    if (file_.segments.max_fraction > 0) {
      const auto image = read_dicom_frame(frame, format);
      if (!image) return image.error();
      const auto most = static_cast<float>(file_.segments.max_fraction);
      for (std::size_t i = 0; i < count; ++i) {
        const float value = image->values[i];
        if (value > most) {
          return refused(frame.name() + ": a value above its MaximumFractionalValue of " +
                         std::to_string(file_.segments.max_fraction));
        }
        if (2 * value >= most) out.push_back(i);
      }
      return out;
    }
    // The bits of all frames follow each other. Within a byte, the lowest bit comes first.
    const std::size_t first = static_cast<std::size_t>(frame.frame) * count, end = first + count;
    const std::size_t from = first / 8, to = (end + 7) / 8;
    std::vector<std::uint8_t> bytes(to - from);
    DcmPixelData* data = dicom_pixel_data(format);
    if (data == nullptr || to > std::numeric_limits<Uint32>::max() ||
        data->getPartialValue(bytes.data(), static_cast<Uint32>(from),
                              static_cast<Uint32>(bytes.size()), nullptr, EBO_LittleEndian)
            .bad()) {
      return refused(frame.name() + ": its pixels cannot be read");
    }
    for (std::size_t k = 0; k < bytes.size(); ++k) {
      if (bytes[k] == 0) continue;  // like most bytes
      for (std::size_t j = 0; j < 8; ++j) {
        const std::size_t bit = (from + k) * 8 + j;
        if ((bytes[k] >> j & 1) != 0 && bit >= first && bit < end) out.push_back(bit - first);
      }
    }
    return out;
  }

  DicomFile file_;
  std::set<int> wanted_;
  std::vector<SlicePlane> planes_;
  std::vector<SliceFrames> frames_;
  mutable ParsedFiles parsed_;
};

// Groups the frames by slice, ascending along the normal. Errors (refused) name two frames that do
// not fit each other.
Result<std::vector<SliceFrames>> slices_of_frames(const DicomFile& file) {
  std::vector<DicomFrame> frames = file.frames;
  const DicomFrame first = frames[0];
  const Eigen::Vector3d normal = first.u.cross(first.v);
  for (const DicomFrame& h : frames) {
    const auto differs = [&](const char* what) {
      return refused(h.name() + ": its " + what + " differs from frame 1");
    };
    if (!same_orientation(h, first)) return differs("orientation");
    if (!same_spacing(h, first)) return differs("pixel spacing");
  }
  std::stable_sort(frames.begin(), frames.end(), [&](const DicomFrame& a, const DicomFrame& b) {
    return normal.dot(a.position) < normal.dot(b.position);
  });
  constexpr double kSame_mm = 1e-3;
  std::vector<SliceFrames> out;
  for (DicomFrame& h : frames) {
    if (out.empty() || normal.dot(h.position - out.back()[0].position) >= kSame_mm)
      out.emplace_back();
    SliceFrames& slice = out.back();
    if (!slice.empty() && (h.position - slice[0].position).norm() >= kSame_mm)
      return refused(h.name() + ": is in one plane with frame " +
                     std::to_string(slice[0].frame + 1) + ", but shifted");
    for (const DicomFrame& other : slice) {
      if (other.segment == h.segment)
        return refused(h.name() + ": is of the same segment and slice as frame " +
                       std::to_string(other.frame + 1));
    }
    slice.push_back(std::move(h));
  }
  for (SliceFrames& slice : out) {
    std::sort(slice.begin(), slice.end(),
              [](const DicomFrame& a, const DicomFrame& b) { return a.segment < b.segment; });
  }
  return out;
}

// Each gap as a number of steps; empty if a gap is not a multiple of the step.
std::vector<int> multiples(const std::vector<double>& gaps_mm, double step_mm) {
  std::vector<int> out;
  for (const double gap : gaps_mm) {
    const double steps = std::round(gap / step_mm);
    if (!(steps >= 1) || steps > kMaxSlices || std::abs(gap - steps * step_mm) > 0.01 * step_mm)
      return {};
    out.push_back(static_cast<int>(steps));
  }
  return out;
}

// Makes slices from the first frame to the last one. Their distance is the step that the file
// states or, if it states none or the frames do not fit it, the smallest distance between frames.
// If the frames do not fit that either, the slices have the positions of the frames.
Result<void> use_slices_of_frames(std::vector<SliceFrames> slices, SegmentationStack& stack) {
  std::vector<double> gaps;
  const DicomFrame first = slices[0][0];
  const Eigen::Vector3d normal = first.u.cross(first.v);
  for (std::size_t i = 1; i < slices.size(); ++i)
    gaps.push_back(normal.dot(slices[i][0].position - slices[i - 1][0].position));
  std::vector<int> steps;
  if (stack.file_.segments.step_mm > 0) steps = multiples(gaps, stack.file_.segments.step_mm);
  if (steps.empty() && !gaps.empty())
    steps = multiples(gaps, *std::min_element(gaps.begin(), gaps.end()));
  if (steps.empty() && !gaps.empty()) {
    stack.warnings.push_back(
        {"uneven_spacing", stack.file_.file.string(),
         "its slices are not evenly spaced, so that left-out ones cannot be found; positions are "
         "kept as they are"});
    steps.assign(gaps.size(), 1);
  }
  std::int64_t count = 1;
  for (const int n : steps)
    count += n;
  if (count > kMaxSlices) {
    return refused(stack.file_.file.string() + ": its frames are spread over " +
                   std::to_string(count) + " slices, at most " + std::to_string(kMaxSlices) +
                   " are read");
  }
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const Eigen::Vector3d here = slices[i][0].position;
    const int n = i < steps.size() ? steps[i] : 1;
    const Eigen::Vector3d step = i + 1 < slices.size()
                                     ? Eigen::Vector3d((slices[i + 1][0].position - here) / n)
                                     : Eigen::Vector3d::Zero();
    for (int k = 0; k < n; ++k)
      stack.planes_.push_back(plane_of(first, here + k * step));
    stack.frames_.push_back(std::move(slices[i]));
    stack.frames_.resize(stack.planes_.size());
  }
  return {};
}

// Uses the slices of the CT. Each frame must lie on one of them.
Result<void> use_slices_of_ct(const SliceStack& ct, std::vector<SliceFrames> slices,
                              SegmentationStack& stack) {
  stack.frames_.resize(static_cast<std::size_t>(ct.size()));
  const DicomFrame& any = stack.file_.frames[0];
  if (ct.width() != any.columns || ct.height() != any.rows) {
    return refused(stack.file_.file.string() + ": has " + std::to_string(any.columns) + " x " +
                   std::to_string(any.rows) + " pixels, the slices of the CT of --hu " +
                   std::to_string(ct.width()) + " x " + std::to_string(ct.height()));
  }
  int k = 0;
  for (SliceFrames& slice : slices) {
    const DicomFrame& h = slice[0];
    const SlicePlane plane = plane_of(h, h.position);
    const Eigen::Vector3d normal = plane.T_lps_plane.linear().col(2);
    const auto distance = [&](int at) {
      return std::abs(normal.dot(ct.plane(at).T_lps_plane.translation() - h.position));
    };
    while (k + 1 < ct.size() && distance(k + 1) <= distance(k))
      ++k;
    if (const auto differs =
            plane_difference(plane, ct.plane(k), ct.width(), ct.height(), slice_step_mm(ct, k))) {
      return refused(h.name() + ": is on no slice of the CT of --hu: compared with " + ct.name(k) +
                     ", its " + *differs);
    }
    // Frames that are apart by rounding can be on one slice of the CT.
    SliceFrames& there = stack.frames_[static_cast<std::size_t>(k)];
    for (DicomFrame& frame : slice) {
      for (const DicomFrame& other : there) {
        if (other.segment == frame.segment)
          return refused(frame.name() + ": is on the same slice of the CT of --hu as frame " +
                         std::to_string(other.frame + 1) + ", with the same segment");
      }
      there.push_back(std::move(frame));
    }
  }
  for (int slice = 0; slice < ct.size(); ++slice)
    stack.planes_.push_back(ct.plane(slice));
  return {};
}

// The slices without a frame, such as "slices 0-3, 7"; empty if there are none.
std::string empty_slices(const std::vector<SliceFrames>& frames) {
  constexpr int kMaxRuns = 12;
  std::set<int> empty;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].empty()) empty.insert(static_cast<int>(i));
  }
  return empty.empty() ? "" : named_ranges("slice", empty, kMaxRuns);
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
    if (const auto ok = named_series(before, options.series).into(uid); !ok) return ok.error();
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

Result<std::unique_ptr<SliceStack>> open_segmentation(const DicomFile& file,
                                                      const OpenOptions& options) {
  if (file.kind != DicomFile::Kind::kSegmentation || file.frames.empty())
    return bug(file.file.string() + ": is no segmentation");
  auto stack = std::make_unique<SegmentationStack>();
  stack->file_ = file;
  stack->wanted_ = options.labels;
  stack->series = file.series;
  stack->files = {file.file};
  stack->label_names = file.segments.names;
  auto slices = slices_of_frames(file);
  if (!slices) return slices.error();
  const bool has_ct = options.segmented_ct != nullptr;
  if (auto ok = has_ct ? use_slices_of_ct(*options.segmented_ct, std::move(*slices), *stack)
                       : use_slices_of_frames(std::move(*slices), *stack);
      !ok)
    return ok.error();
  if (const std::string empty = empty_slices(stack->frames_); !empty.empty()) {
    stack->warnings.push_back(
        {"frames_left_out", file.file.string(),
         "no frames for " + empty + ", which are taken as empty; the extent is that of " +
             (has_ct ? "the CT of --hu" : "its frames, --hu CT gives that of the CT")});
  }
  if (options.axis) return resliced(std::move(stack), *options.axis, file.file.string(), true);
  return std::unique_ptr<SliceStack>(std::move(stack));
}

}  // namespace trocar::pipeline
