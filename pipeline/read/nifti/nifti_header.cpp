// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/read/nifti/nifti_header.h"

#include <nifti2_io.h>

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>

#include "pipeline/read/nifti/form_difference.h"

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
  if (std::memcmp(magic, kFirst ? "ni1" : "ni2", 4) == 0) {
    return refused(file + ": one of a pair of files (.hdr and .img); single .nii files are read");
  }
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

}  // namespace

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
  if (size == 348) {
    image = convert<nifti_1_header>(head, swapped, file, out);
  } else if (size == 540 && head.size() >= sizeof(nifti_2_header)) {
    image = convert<nifti_2_header>(head, swapped, file, out);
  }
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

}  // namespace trocar::pipeline
