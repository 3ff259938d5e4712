// SPDX-License-Identifier: GPL-3.0-or-later
// A segmentation (PS3.3, A.51) has one frame for each segment and slice, in any order. Frames
// without a pixel of the segment are often missing.
#include "pipeline/read/dicom/dicom_segmentation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "pipeline/base/number_ranges.h"
#include "pipeline/read/dicom/dicom_headers.h"
#include "pipeline/read/dicom/dicom_parsed_files.h"
#include "pipeline/read/dicom/dicom_pixels.h"
#include "pipeline/read/nifti/resliced_stack.h"
#include "pipeline/read/same_grid.h"
#include "pipeline/read/slice_stack.h"

namespace trocar::pipeline {
namespace {

constexpr int kMaxSlices = 1 << 15;

std::string segment_text(const DicomSegments& segments, int number) {
  const auto found = segments.names.find(number);
  const bool has_name = found != segments.names.end() && !found->second.empty();
  return std::to_string(number) + (has_name ? " (" + found->second + ")" : "");
}

// The frames of a slice, each of another segment.
using SliceFrames = std::vector<DicomFrame>;

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
    if ((h.u - first.u).norm() > 1e-3 || (h.v - first.v).norm() > 1e-3)
      return differs("orientation");
    if (std::abs(h.spacing_u_mm - first.spacing_u_mm) > 1e-4 ||
        std::abs(h.spacing_v_mm - first.spacing_v_mm) > 1e-4)
      return differs("pixel spacing");
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
