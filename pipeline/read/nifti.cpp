// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nifti.h"

#include <nifti1.h>
#include <nifti2_io.h>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <type_traits>

#include "pipeline/read/number_ranges.h"

namespace trocar::pipeline {
namespace {

using NiftiImage = std::unique_ptr<nifti_image, void (*)(nifti_image*)>;

// Bytes of a voxel; 0: not supported. 128-bit floats are not supported, because they are quadruple
// precision in the standard but have 80 bits in most files.
int bytes_of(int datatype) {
  constexpr std::array kReal{NIFTI_TYPE_UINT8,  NIFTI_TYPE_INT8,   NIFTI_TYPE_UINT16,
                             NIFTI_TYPE_INT16,  NIFTI_TYPE_UINT32, NIFTI_TYPE_INT32,
                             NIFTI_TYPE_UINT64, NIFTI_TYPE_INT64,  NIFTI_TYPE_FLOAT32,
                             NIFTI_TYPE_FLOAT64};
  if (std::find(kReal.begin(), kReal.end(), datatype) == kReal.end()) return 0;
  int bytes = 0, swap_size = 0;
  nifti_datatype_sizes(datatype, &bytes, &swap_size);
  return bytes;
}

// Does the header state the voxel size? The sform's matrix contains it; without an sform, pixdim
// states it. (libnifti2 replaces missing sizes by 1, and with a qform also negative ones.) dim[0]
// must have been checked.
template <typename Header>
bool has_voxel_size(const Header& h) {
  if (h.sform_code > 0) return true;
  return std::all_of(h.pixdim + 1, h.pixdim + 1 + std::min<std::int64_t>(3, h.dim[0]),
                     [&](double size) {
                       return std::isfinite(size) && (h.qform_code > 0 ? size > 0 : size != 0);
                     });
}

// Does the header state a qform that can be compared with its sform? (libnifti2 replaces what is
// missing.)
template <typename Header>
bool states_qform(const Header& h) {
  const auto is_side = [](double size) { return std::isfinite(size) && size > 0; };
  return h.qform_code > 0 &&
         std::all_of(h.pixdim + 1, h.pixdim + 1 + std::min<std::int64_t>(3, h.dim[0]), is_side) &&
         std::isfinite(h.quatern_b) && std::isfinite(h.quatern_c) && std::isfinite(h.quatern_d) &&
         std::isfinite(h.qoffset_x) && std::isfinite(h.qoffset_y) && std::isfinite(h.qoffset_z);
}

// Converts the header to this machine's byte order and lets libnifti2 interpret it. Sizes are
// checked here, on the header itself, because the library multiplies them without a check.
template <typename Header>
Result<NiftiImage> convert(const std::vector<std::uint8_t>& head, bool swapped,
                           const std::string& file, NiftiHeader& out) {
  Header h;
  std::memcpy(&h, head.data(), sizeof h);
  constexpr bool kFirst = sizeof(Header) == sizeof(nifti_1_header);
  const char* magic = h.magic;
  if (std::memcmp(magic, kFirst ? "ni1" : "ni2", 4) == 0)
    return refused(file + ": one of a pair of files (.hdr and .img); single .nii files are read");
  if (std::memcmp(magic, kFirst ? "n+1" : "n+2", 4) != 0)
    return refused(file + ": not a NIfTI file (no magic number)");
  if (swapped) swap_nifti_header(&h, kFirst ? 1 : 2);
  if (h.dim[0] < 1 || h.dim[0] > 7)
    return refused(file + ": " + std::to_string(h.dim[0]) + " dimensions");
  for (int i = 1; i <= 7; ++i) {
    const std::int64_t side = i <= h.dim[0] ? static_cast<std::int64_t>(h.dim[i]) : 1;
    if (i <= 3 && (side < 1 || side > kMaxImageSide))
      return refused(file + ": a side of " + std::to_string(side) + " voxels");
    if (i > 3 && side > 1) {
      if (side > kMaxVolumes || out.volumes * side > kMaxVolumes)
        return refused(file + ": more than " + std::to_string(kMaxVolumes) + " volumes");
      out.volumes *= side;
    }
  }
  for (int i = static_cast<int>(h.dim[0]) + 1; i <= 7; ++i)
    h.dim[i] = 1;
  const auto start = static_cast<double>(h.vox_offset);
  if (start != 0 && !(start >= static_cast<double>(sizeof(Header)) && start < 1e12))
    return refused(file + ": voxels at byte " + std::to_string(start));
  if (bytes_of(h.datatype) == 0 || h.bitpix != 8 * bytes_of(h.datatype)) {
    return refused(file + ": voxel type " + std::string(nifti_datatype_string(h.datatype)) +
                   " of " + std::to_string(h.bitpix) + " bits is not a real number");
  }
  out.has_voxel_size = has_voxel_size(h);
  out.states_qform = states_qform(h);
  if (h.sform_code > 0) {
    out.pixdim_beside_sform_mm = {std::abs(h.pixdim[1]), std::abs(h.pixdim[2]),
                                  h.dim[0] < 3 ? 0 : std::abs(h.pixdim[3])};
  }
  if constexpr (kFirst) {
    return NiftiImage(nifti_convert_n1hdr2nim(h, file.c_str()), nifti_image_free);
  } else {
    return NiftiImage(nifti_convert_n2hdr2nim(h, file.c_str()), nifti_image_free);
  }
}

Eigen::Matrix4d matrix_of(const nifti_dmat44& m) {
  Eigen::Matrix4d out;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c)
      out(r, c) = m.m[r][c];
  }
  return out;
}

Eigen::Matrix4d to_lps(const Eigen::Matrix4d& ras) {
  return Eigen::Vector4d(-1, -1, 1, 1).asDiagonal() * ras;
}

// The matrix from voxels to the patient in LPS mm. It comes from the sform or the qform or, if both
// are missing, from the voxel sizes.
Eigen::Matrix4d voxel_to_lps(const nifti_image& image, const std::string& file,
                             std::vector<Warning>& warnings) {
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  if (image.sform_code > 0) {
    T = matrix_of(image.sto_xyz);
  } else if (image.qform_code > 0) {
    T = matrix_of(image.qto_xyz);
  } else {
    T.diagonal() << std::abs(image.dx), std::abs(image.dy), std::abs(image.dz), 1.0;
    warnings.push_back({"no_orientation", file,
                        "the file has neither sform nor qform; array axes are taken as right, "
                        "anterior, superior"});
  }
  return to_lps(T);
}

// The file's unit of length, in mm. It is 1 for files that name no unit, and 0 if the unit is
// unknown.
double unit_mm(int xyz_units) {
  switch (xyz_units) {
    case NIFTI_UNITS_UNKNOWN:
    case NIFTI_UNITS_MM:
      return 1;
    case NIFTI_UNITS_METER:
      return 1000;
    case NIFTI_UNITS_MICRON:
      return 0.001;
    default:
      return 0;
  }
}

// The orthogonal matrix that is nearest to the array's axes.
Eigen::Matrix3d directions(const Eigen::Matrix4d& form) {
  const Eigen::Matrix3d axes = form.topLeftCorner<3, 3>().colwise().normalized();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(axes, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return svd.matrixU() * svd.matrixV().transpose();
}

std::string sides_text(const Eigen::Matrix4d& form) {
  std::string out;
  for (int k = 0; k < 3; ++k)
    out += (k == 0 ? "" : " x ") + text_of(form.col(k).head<3>().norm(), 4);
  return out + " mm";
}

double angle_deg(const Eigen::Matrix3d& rotation) {
  return Eigen::AngleAxisd(rotation).angle() * 180 / std::numbers::pi;
}

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

// Reads NIfTI-1 and -2, plain or gzipped, with any order of axes. Slices are stacked along the
// array axis that is nearest to the chosen anatomical axis. Rows and columns get the usual
// directions of the view by the order in which voxels are read, never by resampling. Voxels stay on
// disk.
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

// Errors (refused): the slices do not form a regular volume.
Result<void> check_volume(const SliceStack& stack, const std::string& where) {
  const std::string reason = ": --axis needs a volume of evenly spaced slices without tilt; ";
  if (stack.size() < 2) return refused(where + reason + "it has one slice");
  const StackShape shape = stack_shape(stack);
  char text[64];
  if (shape.is_tilted()) {
    std::snprintf(text, sizeof text, "these are tilted by %.1f degrees", shape.tilt_deg);
    return refused(where + reason + text);
  }
  if (const auto at = shape.first_uneven()) {
    std::snprintf(text, sizeof text, " are %.4g mm apart, others %.4g mm", shape.gaps_mm[*at],
                  shape.step_mm);
    return refused(where + reason + stack.name(static_cast<int>(*at)) + " and " +
                   stack.name(static_cast<int>(*at) + 1) + text);
  }
  return {};
}

// Describes how `qform` places an array of `n` voxels compared with `sform`: mirrored, rotated (in
// degrees), shifted (in mm, at the array's centre), with other voxel sizes, and how far a voxel
// moves at most. Empty if the two have the same handedness and no corner of the array moves by more
// than half a voxel along an axis of the array. Both matrices map voxel indices to LPS, mm.
// Precondition: their determinants are not 0.
std::string form_difference(const Eigen::Matrix4d& qform, const Eigen::Matrix4d& sform,
                            const std::array<std::int64_t, 3>& n) {
  constexpr double kMaxVoxels = 0.5;
  const Eigen::Array3d last(static_cast<double>(n[0] - 1), static_cast<double>(n[1] - 1),
                            static_cast<double>(n[2] - 1));
  const auto apart_mm = [&](const Eigen::Array3d& voxel) -> Eigen::Vector3d {
    return ((qform - sform) * voxel.matrix().homogeneous()).head<3>();
  };
  const Eigen::Matrix3d to_voxels = sform.topLeftCorner<3, 3>().inverse();
  double most_mm = 0, most_voxels = 0;
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d apart =
        apart_mm(last * Eigen::Array3d(corner & 1, corner >> 1 & 1, corner >> 2));
    most_mm = std::max(most_mm, apart.norm());
    most_voxels = std::max(most_voxels, (to_voxels * apart).cwiseAbs().maxCoeff());
  }
  const Eigen::Matrix3d from = directions(sform), to = directions(qform);
  Eigen::Matrix3d turn = to * from.transpose();
  const bool is_mirrored = turn.determinant() < 0;
  if (!is_mirrored && !(most_voxels > kMaxVoxels)) return {};

  std::string out;
  const auto add = [&out](const std::string& text) { out += (out.empty() ? "" : ", ") + text; };
  if (is_mirrored) {
    // The mirror that leaves the smallest rotation.
    constexpr std::array<const char*, 3> kAxes{"from left to right", "from front to back",
                                               "from head to feet"};
    int best = 0;
    Eigen::Matrix3d left = turn;
    for (int k = 0; k < 3; ++k) {
      Eigen::Matrix3d mirror = Eigen::Matrix3d::Identity();
      mirror(k, k) = -1;
      const Eigen::Matrix3d rest = turn * mirror;
      if (k > 0 && !(angle_deg(rest) < angle_deg(left) - 1e-6)) continue;
      best = k;
      left = rest;
    }
    turn = left;
    add(std::string("mirrored ") + kAxes[static_cast<std::size_t>(best)]);
  }
  if (const double angle = angle_deg(turn); angle > 0.01)
    add("rotated by " + text_of(angle, 4) + " degrees");
  if (const double shift = apart_mm(last / 2).norm(); shift > 0.001)
    add("shifted by " + text_of(shift, 4) + " mm");
  for (int k = 0; k < 3; ++k) {
    const double by_sform = sform.col(k).head<3>().norm();
    if (!(std::abs(qform.col(k).head<3>().norm() - by_sform) > 1e-3 * by_sform)) continue;
    add("has voxels of " + sides_text(qform) + " instead of " + sides_text(sform));
    break;
  }
  add("a voxel moves by up to " + text_of(most_mm, 4) + " mm");
  return out;
}

// Parses `head`, the first kNiftiHeadBytes bytes of a file or all if it has fewer. `file` is the
// file's name in error messages. A file with more than three dimensions may hold several volumes.
// Volumes are numbered from 0 in the order of the file, and `volume` is the number of the wanted
// volume.
//
// Errors: kRefused if the file is not NIfTI or is one of a pair of files (.hdr and .img), if the
// voxels are not real scalars, if a side or the voxels' offset is out of range, if the unit of
// length is unknown, or if the matrix from voxels to the patient is not finite or out of range;
// kUsage if the file has several volumes and `volume` is missing, or if there is no volume of that
// number. Warnings: no_orientation, qform_differs.
Result<NiftiHeader> parse_nifti_header(const std::vector<std::uint8_t>& head,
                                       const std::string& file, std::optional<int> volume,
                                       std::vector<Warning>& warnings) {
  nifti_set_debug_level(0);
  if (head.size() < sizeof(nifti_1_header))
    return refused(file + ": not a NIfTI file (shorter than its header)");
  std::uint32_t size;
  std::memcpy(&size, head.data(), sizeof size);
  const bool swapped = size == __builtin_bswap32(348) || size == __builtin_bswap32(540);
  if (swapped) size = __builtin_bswap32(size);
  NiftiHeader out;
  Result<NiftiImage> image = refused(file + ": not a NIfTI file (no header of 348 or 540 bytes)");
  if (size == 348)
    image = convert<nifti_1_header>(head, swapped, file, out);
  else if (size == 540 && head.size() >= sizeof(nifti_2_header))
    image = convert<nifti_2_header>(head, swapped, file, out);
  if (!image) return image.error();
  if (*image == nullptr) return refused(file + ": its header is not acceptable");

  const nifti_image& m = **image;
  out.n = {m.nx, m.ny, m.nz};
  for (std::int64_t side : out.n) {
    if (side < 1 || side > kMaxImageSide)
      return refused(file + ": a side of " + std::to_string(side) + " voxels");
  }
  out.datatype = m.datatype;
  out.bytes_per_voxel = bytes_of(m.datatype);
  out.swapped = swapped;
  out.data_start = m.iname_offset > 0 ? m.iname_offset : (size == 348 ? 352 : 544);
  if (auto ok = choose_volume(file, volume, out); !ok) return ok.error();
  const double mm = unit_mm(m.xyz_units);
  if (mm == 0) return refused(file + ": unit of length " + std::to_string(m.xyz_units));
  out.T_lps_voxel = voxel_to_lps(m, file, warnings);
  out.T_lps_voxel.topRows<3>() *= mm;
  if (out.pixdim_beside_sform_mm) {
    for (double& side : *out.pixdim_beside_sform_mm)
      side *= mm;
  }
  if (!out.T_lps_voxel.allFinite() || !(out.T_lps_voxel.cwiseAbs().maxCoeff() < 1e7))
    return refused(file + ": its affine is not finite or out of range");
  if (m.sform_code > 0 && m.qform_code > 0 && out.states_qform) {
    Eigen::Matrix4d qform = to_lps(matrix_of(m.qto_xyz));
    qform.topRows<3>() *= mm;
    const bool is_valid = qform.allFinite() && qform.topLeftCorner<3, 3>().determinant() != 0 &&
                          out.T_lps_voxel.topLeftCorner<3, 3>().determinant() != 0;
    if (const std::string how =
            is_valid ? form_difference(qform, out.T_lps_voxel, out.n) : std::string();
        !how.empty())
      warnings.push_back({"qform_differs", file,
                          "its qform places the scan otherwise than its sform, which is used; by "
                          "the qform it is " +
                              how});
  }
  if (m.scl_slope != 0 && std::isfinite(m.scl_slope) && std::isfinite(m.scl_inter)) {
    out.slope = m.scl_slope;
    out.intercept = m.scl_inter;
  }
  return out;
}

// Makes a stack with slices along `axis` from an array of voxels: `header` describes the array,
// and `voxels` has its values. Slices are stacked along the array axis that is nearest to `axis`.
// `name` is the input's name in error messages. Errors: kRefused if the axes of the array span no
// volume, if rows and columns of a slice are not at right angles, or if a slice is too small or
// too large.
Result<std::unique_ptr<SliceStack>> open_voxels(const std::string& name, const NiftiHeader& header,
                                                VolumeFile voxels, SliceAxis axis) {
  auto stack = without_voxels(name, header, axis);
  if (!stack) return stack.error();
  (*stack)->voxels_ = std::move(voxels);
  return std::unique_ptr<SliceStack>(std::move(*stack));
}

}  // namespace

Result<void> choose_volume(const std::string& file, std::optional<int> volume,
                           NiftiHeader& header) {
  constexpr double kMaxBytes = 0x1p60;
  const std::string range = "0:" + std::to_string(header.volumes - 1);
  if (!volume && header.volumes > 1) {
    return usage(file + ": holds " + std::to_string(header.volumes) +
                 " volumes (a fourth dimension); choose one of " + range + " with --volume");
  }
  if (volume && (*volume < 0 || *volume >= header.volumes))
    return usage(file + ": --volume " + std::to_string(*volume) + " is outside " + range);
  if (static_cast<double>(header.volumes) * static_cast<double>(header.data_bytes()) > kMaxBytes)
    return refused(file + ": its header declares more than 2^60 bytes of voxels");
  header.data_end = header.data_start + header.volumes * header.data_bytes();
  header.data_start += volume.value_or(0) * header.data_bytes();
  return {};
}
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
Result<std::unique_ptr<SliceStack>> resliced(std::unique_ptr<SliceStack> stack, SliceAxis axis,
                                             const std::string& where, bool as_labels) {
  if (auto ok = check_volume(*stack, where); !ok) return ok.error();
  const SlicePlane &first = stack->plane(0), &last = stack->plane(stack->size() - 1);
  const Eigen::Vector3d from = first.T_lps_plane.translation();
  NiftiHeader header;
  header.n = {stack->width(), stack->height(), stack->size()};
  header.datatype = as_labels ? NIFTI_TYPE_INT32 : NIFTI_TYPE_FLOAT32;
  header.bytes_per_voxel = 4;
  header.T_lps_voxel.col(0).head<3>() = first.T_lps_plane.linear().col(0) * first.spacing_u_mm;
  header.T_lps_voxel.col(1).head<3>() = first.T_lps_plane.linear().col(1) * first.spacing_v_mm;
  header.T_lps_voxel.col(2).head<3>() =
      (last.T_lps_plane.translation() - from) / (stack->size() - 1);
  header.T_lps_voxel.col(3).head<3>() = from;
  auto voxels = VolumeFile::temporary(where);
  if (!voxels) return voxels.error();
  const auto append = [&](const auto& image) -> Result<void> {
    if (!image) return image.error();
    const auto* bytes = reinterpret_cast<const char*>(image->values.data());
    return voxels->append({bytes, image->values.size() * 4}, where);
  };
  for (int k = 0; k < stack->size(); ++k) {
    if (auto ok = as_labels ? append(stack->read_labels(k)) : append(stack->read(k)); !ok)
      return ok.error();
  }
  auto out = open_voxels(where, header, std::move(*voxels), axis);
  if (!out) return out.error();
  (*out)->warnings = std::move(stack->warnings);
  (*out)->series = std::move(stack->series);
  (*out)->modality = std::move(stack->modality);
  (*out)->files = std::move(stack->files);
  (*out)->label_names = std::move(stack->label_names);
  return out;
}

}  // namespace trocar::pipeline
