// SPDX-License-Identifier: GPL-3.0-or-later
// Reads NIfTI-1 and -2, plain or gzipped, with any order of axes. Slices are stacked along the
// array axis that is nearest to the chosen anatomical axis. Rows and columns get the usual
// directions of the view by the order in which voxels are read, never by resampling. Voxels stay on
// disk.
#include "pipeline/read/nifti/nifti_stack.h"

#include <nifti1.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "pipeline/read/label_values.h"
#include "pipeline/read/nifti/nifti_header.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/read/volume_file.h"
#include "pipeline/read/voxel_volume.h"

namespace trocar::pipeline {
namespace {

// The directions of u, v and the slices in LPS, as they are usual in DICOM for this axis.
std::array<Eigen::Vector3d, 3> view_directions(SliceAxis axis) {
  const Eigen::Vector3d x = Eigen::Vector3d::UnitX(), y = Eigen::Vector3d::UnitY(),
                        z = Eigen::Vector3d::UnitZ();
  switch (axis) {
    case SliceAxis::kCoronal:
      return {x, -z, y};  // from front to back
    case SliceAxis::kSagittal:
      return {y, -z, -x};  // from left to right
    case SliceAxis::kAxial:
      break;
  }
  return {x, y, z};  // from the feet to the head
}

// Tests the exponents without branches, so that the compiler vectorises the loop.
bool are_finite(const std::vector<float>& values) {
  constexpr std::uint32_t kExponent = 0x7f800000;
  std::uint32_t none = 0;
  for (const float v : values)
    none |= (std::bit_cast<std::uint32_t>(v) & kExponent) == kExponent ? 1U : 0U;
  return none == 0;
}

class NiftiStack final : public SliceStack {
 public:
  int size() const override { return static_cast<int>(planes_.size()); }
  int width() const override { return static_cast<int>(n_[0]); }
  int height() const override { return static_cast<int>(n_[1]); }
  PixelUnit pixel_unit() const override {
    return modality.empty() ? PixelUnit::kHounsfield : PixelUnit::kUncalibrated;
  }
  const SlicePlane& plane(int slice) const override { return planes_[slice]; }
  std::string name(int slice) const override { return file_ + " slice " + std::to_string(slice); }

  Result<Image> read(int slice) const override {
    Image out{width(), height(), {}};
    if (const auto ok = read_values(slice, out.values); !ok) return ok.error();
    if (are_finite(out.values)) return out;
    for (float& value : out.values) {
      if (std::isinf(value)) return refused(name(slice) + ": an infinite voxel");
      if (!std::isnan(value)) continue;
      value = kNoData_HU;
      ++out.not_numbers;
    }
    return out;
  }

  Result<LabelImage> read_labels(int slice) const override {
    thread_local std::vector<double> values;
    if (const auto ok = read_values(slice, values); !ok) return ok.error();
    return to_labels(values, width(), height(), name(slice));
  }

  Result<void> finish() const override { return voxels_.finish(); }
  double waited_ms() const override { return voxels_.waited_ms(); }

  // `Value` is float or double. Every integer of up to 53 bits is exact in doubles.
  template <typename Value>
  Result<void> read_values(int slice, std::vector<Value>& out) const {
    out.resize(static_cast<std::size_t>(n_[0] * n_[1]));
    const std::int64_t fixed = flipped_[2] ? n_[2] - 1 - slice : slice;
    // If slices are stacked along the array's slowest axis, a slice is one block of the file.
    // Otherwise it consists of a row or a column of each plane.
    const int slowest_used = axis_[2] == 2 ? 1 : 2;
    const std::int64_t runs = axis_[2] == 2 ? 1 : header_.n[2];
    const std::int64_t block =
        (axis_[2] == 1 ? header_.n[0] : header_.n[0] * header_.n[1]) * header_.bytes_per_voxel;
    thread_local std::vector<char> bytes;  // kept for the next slice, because fresh pages take time
    bytes.resize(static_cast<std::size_t>(block));
    for (std::int64_t run = 0; run < runs; ++run) {
      const std::int64_t plane = axis_[2] == 2 ? fixed : run;
      const std::int64_t row = axis_[2] == 1 ? fixed : 0;
      const std::int64_t at = (plane * header_.n[1] + row) * header_.n[0] * header_.bytes_per_voxel;
      if (const auto ok = voxels_.read(at, bytes, name(slice)); !ok) return ok.error();
      write_pixels(bytes, fixed, slowest_used == 2 ? run : -1, out);
    }
    return {};
  }

  // Converts one plane of the array, or one row or column of it, and writes it to its pixels.
  // `plane` is the index along the slowest axis, or -1 if slices are stacked along that axis.
  template <typename Value>
  void write_pixels(const std::vector<char>& bytes, std::int64_t fixed, std::int64_t plane,
                    std::vector<Value>& out) const {
    const std::int64_t columns = header_.n[0];
    const std::int64_t rows = axis_[2] == 1 ? 1 : header_.n[1];
    // The offset in the image of one step along each axis of the array.
    std::array<std::int64_t, 3> step{};
    std::int64_t first = 0;
    for (int k = 0; k < 2; ++k) {
      const std::int64_t stride = k == 0 ? 1 : n_[0];
      step[axis_[k]] = flipped_[k] ? -stride : stride;
      if (flipped_[k]) first += stride * (n_[k] - 1);
    }
    if (plane >= 0) first += plane * step[2];
    const bool column_only = axis_[2] == 0;
    const std::int64_t i0 = column_only ? fixed : 0, i1 = column_only ? fixed + 1 : columns;
    // If the shift is a small whole number, the sum is exact in 32 bits, and so is its conversion
    // to float.
    const bool is_small_shift = header_.slope == 1 && std::abs(header_.intercept) < 1 << 20 &&
                                header_.intercept == std::rint(header_.intercept);
    dispatch([&](auto zero) {
      using T = decltype(zero);
      for (std::int64_t j = 0; j < rows; ++j) {
        const char* const from = bytes.data() + j * columns * static_cast<std::int64_t>(sizeof(T));
        Value* const to = out.data() + first + j * step[1];
        // Scans usually have steps of 1 or -1 and at most a shift. For these the compiler
        // vectorises the loops.
        const auto put = [&](auto number_at) {
          if (step[0] == 1) {
            for (std::int64_t i = i0; i < i1; ++i)
              to[i] = number_at(i);
          } else if (step[0] == -1) {
            for (std::int64_t i = i0; i < i1; ++i)
              to[-i] = number_at(i);
          } else {
            for (std::int64_t i = i0; i < i1; ++i)
              to[i * step[0]] = number_at(i);
          }
        };
        if (header_.swapped) {
          put([&](std::int64_t i) { return number<Value>(swapped_value_at<T>(from, i)); });
        } else if (std::is_integral_v<T> && sizeof(T) <= 2 && is_small_shift) {
          const auto shift = static_cast<std::int32_t>(header_.intercept);
          put([&](std::int64_t i) {
            return static_cast<Value>(static_cast<std::int32_t>(value_at<T>(from, i)) + shift);
          });
        } else {
          put([&](std::int64_t i) { return number<Value>(value_at<T>(from, i)); });
        }
      }
    });
  }

  template <typename T>
  static T value_at(const char* from, std::int64_t i) {
    T value;
    std::memcpy(&value, from + i * static_cast<std::int64_t>(sizeof(T)), sizeof(T));
    return value;
  }
  template <typename T>
  static T swapped_value_at(const char* from, std::int64_t i) {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), from + i * static_cast<std::int64_t>(sizeof(T)), sizeof(T));
    std::reverse(raw.begin(), raw.end());
    return std::bit_cast<T>(raw);
  }
  // A cast beyond the range of float is undefined, so the value becomes infinite; read() refuses
  // it. Voxels that are not numbers stay unchanged.
  template <typename Value, typename T>
  Value number(T value) const {
    const double scaled = static_cast<double>(value) * header_.slope + header_.intercept;
    if constexpr (std::is_same_v<Value, double>) return scaled;
    return std::abs(scaled) <= 3e38 || std::isnan(scaled) ? static_cast<Value>(scaled) : INFINITY;
  }

  // Calls f with a zero of the voxel type. parse_nifti_header() accepts no types other than these.
  template <typename F>
  void dispatch(F f) const {
    switch (header_.datatype) {
      case NIFTI_TYPE_UINT8:
        return f(std::uint8_t{});
      case NIFTI_TYPE_INT8:
        return f(std::int8_t{});
      case NIFTI_TYPE_UINT16:
        return f(std::uint16_t{});
      case NIFTI_TYPE_INT16:
        return f(std::int16_t{});
      case NIFTI_TYPE_UINT32:
        return f(std::uint32_t{});
      case NIFTI_TYPE_INT32:
        return f(std::int32_t{});
      case NIFTI_TYPE_UINT64:
        return f(std::uint64_t{});
      case NIFTI_TYPE_INT64:
        return f(std::int64_t{});
      case NIFTI_TYPE_FLOAT32:
        return f(float{});
      default:
        return f(double{});
    }
  }

  std::string file_;
  NiftiHeader header_;
  VolumeFile voxels_;
  std::array<std::int64_t, 3> n_{};  // sizes along u, v and the slices
  std::array<int, 3> axis_{};        // the array's axes of u, v and the slices
  std::array<bool, 3> flipped_{};    // whether these axes are read backwards
  std::vector<SlicePlane> planes_;
};

// Makes the stack without its voxels: assigns the array's axes and computes the planes.
Result<std::unique_ptr<NiftiStack>> without_voxels(const std::string& file,
                                                   const NiftiHeader& header, SliceAxis view) {
  auto stack = std::make_unique<NiftiStack>();
  stack->file_ = file;
  stack->header_ = header;
  const Eigen::Matrix4d& T = header.T_lps_voxel;

  // The array axes for u, v and the slices: the assignment whose unit vectors lie closest to the
  // directions of the view.
  const std::array<Eigen::Vector3d, 3> wanted = view_directions(view);
  std::array<int, 3> axis{0, 1, 2};
  double best_score = -1;
  do {
    double score = 0;
    for (int k = 0; k < 3; ++k)
      score += std::abs(T.col(axis[k]).head<3>().normalized().dot(wanted[k]));
    if (score > best_score) best_score = score, stack->axis_ = axis;
  } while (std::next_permutation(axis.begin(), axis.end()));

  Eigen::Vector3d origin = T.col(3).head<3>();
  std::array<Eigen::Vector3d, 3> direction;
  for (int k = 0; k < 3; ++k) {
    const int a = stack->axis_[k];
    stack->n_[k] = header.n[a];
    direction[k] = T.col(a).head<3>();
    stack->flipped_[k] = direction[k].dot(wanted[k]) < 0;
    if (stack->flipped_[k]) {
      origin += direction[k] * static_cast<double>(header.n[a] - 1);
      direction[k] = -direction[k];
    }
  }
  const double su = direction[0].norm(), sv = direction[1].norm();
  if (!(su > 1e-6 && sv > 1e-6 && direction[2].norm() > 1e-6))
    return refused(file + ": a voxel size of zero");
  const Eigen::Vector3d u = direction[0] / su;
  Eigen::Vector3d v = direction[1] / sv;
  if (!(std::abs(u.dot(v)) <= 1e-3))
    return refused(file + ": its rows and columns are not at right angles (its matrix shears by " +
                   shear_text(T.topLeftCorner<3, 3>()) + "); slices along another --axis may be");
  v = (v - u * u.dot(v)).normalized();
  const Eigen::Vector3d normal = u.cross(v);
  if (!(normal.dot(direction[2]) > 0)) return refused(file + ": its affine has no volume");
  if (stack->n_[0] < 2 || stack->n_[1] < 2 || stack->n_[0] * stack->n_[1] > kMaxSlicePixels)
    return refused(file + ": slices of " + std::to_string(stack->n_[0]) + " x " +
                   std::to_string(stack->n_[1]) + " voxels");

  for (std::int64_t i = 0; i < stack->n_[2]; ++i) {
    SlicePlane plane{su, sv, Eigen::Affine3d::Identity(), 0};
    plane.T_lps_plane.linear() << u, v, normal;
    plane.T_lps_plane.translation() = origin + direction[2] * static_cast<double>(i);
    plane.z_mm = normal.dot(plane.T_lps_plane.translation());
    stack->planes_.push_back(plane);
  }
  return stack;
}

}  // namespace

Result<std::unique_ptr<SliceStack>> open_array(const std::string& file, NiftiHeader header,
                                               const OpenOptions& options,
                                               std::vector<Warning> warnings,
                                               const std::function<Result<VolumeFile>()>& open) {
  if (options.any_modality) {
    warnings.push_back({"no_modality", file,
                        "the file names no modality; the values are taken as HU of a CT, with "
                        "and without --any-modality"});
  }
  if (!header.has_voxel_size) {
    if (!options.spacing_mm)
      return usage(file + ": carries no voxel size: give --spacing X,Y,Z in mm");
    Eigen::Matrix4d& T = header.T_lps_voxel;
    for (int k = 0; k < 3; ++k)
      T.col(k).head<3>() *= (*options.spacing_mm)[k] / T.col(k).head<3>().norm();
  } else if (options.spacing_mm) {
    warnings.push_back({"spacing_ignored", file,
                        "--spacing is for input without a voxel size; the file's own is used"});
  }
  auto stack = without_voxels(file, header, options.axis.value_or(SliceAxis::kAxial));
  if (!stack) return stack.error();
  (*stack)->warnings = std::move(warnings);
  if (header.pixdim_beside_sform_mm) {
    auto& conflict = (*stack)->voxel_conflict;
    conflict =
        voxel_conflict(header.T_lps_voxel.topLeftCorner<3, 3>(), *header.pixdim_beside_sform_mm);
    const SlicePlane& plane = (*stack)->plane(0);
    if (conflict) conflict->pixel_mm2 = plane.spacing_u_mm * plane.spacing_v_mm;
  }
  if (open) {
    auto voxels = open();
    if (!voxels) return voxels.error();
    (*stack)->voxels_ = std::move(*voxels);
  }
  return std::unique_ptr<SliceStack>(std::move(*stack));
}

Result<std::unique_ptr<SliceStack>> open_nifti(const std::filesystem::path& path,
                                               const OpenOptions& options, bool header_only) {
  const std::string file = path.string();
  std::vector<Warning> warnings;
  const auto head = VolumeFile::head(path, kNiftiHeadBytes);
  if (!head) return head.error();
  const auto header = parse_nifti_header(*head, file, options.volume, warnings);
  if (!header) return header.error();
  const auto open = [&] {
    return VolumeFile::open(path, header->data_start, header->data_bytes(), options.unpack_behind,
                            header->data_end);
  };
  return open_array(file, *header, options, std::move(warnings),
                    header_only ? std::function<Result<VolumeFile>()>() : open);
}

Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis) {
  auto stack = without_voxels(name, header, axis);
  if (!stack) return stack.error();
  (*stack)->voxels_ = std::move(voxels);
  return std::unique_ptr<SliceStack>(std::move(*stack));
}

}  // namespace trocar::pipeline
