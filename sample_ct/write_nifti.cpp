// SPDX-License-Identifier: Apache-2.0
// libnifti makes the header. The file is written here, because nifti_image_write() cannot
// report a failed write.
#include "sample_ct/write_nifti.h"

#include <zlib.h>

#include <array>
#include <bit>
#include <cstdio>
#include <cstring>
#include <memory>

#include <nifti2_io.h>

#include "formats/base/files.h"

namespace trocar::sample {
namespace {

static_assert(std::endian::native == std::endian::little,
              "the voxels are written as they are in memory");

struct FreeImage {
  void operator()(nifti_image* image) const { nifti_image_free(image); }
};

/// The header with the geometry. The conversion from LPS to RAS negates x and y.
Result<nifti_1_header> make_header(const Scan& scan) {
  const ScanGeometry& g = scan.geometry;
  const std::array<std::int64_t, 8> dims{3, g.columns, g.rows, g.slices, 1, 1, 1, 1};
  const std::unique_ptr<nifti_image, FreeImage> image(
      nifti_make_new_nim(dims.data(), NIFTI_TYPE_INT16, 0));
  if (!image) return bug("libnifti made no header");

  nifti_dmat44 to_ras{};
  to_ras.m[0][0] = -g.pixel_mm;
  to_ras.m[1][1] = -g.pixel_mm;
  to_ras.m[2][2] = g.slice_step_mm;
  to_ras.m[0][3] = -g.first_pixel_mm.x;
  to_ras.m[1][3] = -g.first_pixel_mm.y;
  to_ras.m[2][3] = g.first_pixel_mm.z;
  to_ras.m[3][3] = 1;
  image->sto_xyz = to_ras;
  image->sform_code = image->qform_code = NIFTI_XFORM_SCANNER_ANAT;
  nifti_dmat44_to_quatern(to_ras, &image->quatern_b, &image->quatern_c, &image->quatern_d,
                          &image->qoffset_x, &image->qoffset_y, &image->qoffset_z, &image->dx,
                          &image->dy, &image->dz, &image->qfac);
  image->pixdim[1] = image->dx;
  image->pixdim[2] = image->dy;
  image->pixdim[3] = image->dz;
  image->xyz_units = NIFTI_UNITS_MM;
  image->scl_slope = 1;
  image->scl_inter = 0;
  image->nifti_type = NIFTI_FTYPE_NIFTI1_1;
  image->iname_offset = 352;
  std::snprintf(image->descrip, sizeof image->descrip, "lumbar vertebra phantom, seed %llu",
                static_cast<unsigned long long>(scan.seed));
  nifti_1_header header{};
  if (nifti_convert_nim2n1hdr(image.get(), &header) != 0) return bug("libnifti made no header");
  return header;
}

Result<std::vector<std::uint8_t>> gzip(const std::vector<std::uint8_t>& bytes) {
  z_stream stream{};
  constexpr int kGzipWrapper = 16;
  // On the scan's noise, this level takes a third of the time of zlib's default and packs no worse.
  constexpr int kLevel = 3;
  if (deflateInit2(&stream, kLevel, Z_DEFLATED, MAX_WBITS + kGzipWrapper, 8, Z_DEFAULT_STRATEGY) !=
      Z_OK)
    return bug("zlib could not be set up");
  std::vector<std::uint8_t> packed(deflateBound(&stream, static_cast<uLong>(bytes.size())));
  stream.next_in = const_cast<Bytef*>(bytes.data());
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = packed.data();
  stream.avail_out = static_cast<uInt>(packed.size());
  const int outcome = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  if (outcome != Z_STREAM_END) return bug("zlib could not compress the scan");
  return packed;
}

}  // namespace

Result<void> write_nifti(const Scan& scan, const std::filesystem::path& file) {
  const Result<nifti_1_header> header = make_header(scan);
  if (!header) return header.error();
  constexpr std::size_t kDataOffset =
      352;  // the header, then four bytes that state that there is no extension
  static_assert(sizeof(nifti_1_header) == 348);
  std::vector<std::uint8_t> bytes(kDataOffset + scan.hu.size() * sizeof(std::int16_t));
  std::memcpy(bytes.data(), &*header, sizeof(nifti_1_header));
  std::memcpy(bytes.data() + kDataOffset, scan.hu.data(), scan.hu.size() * sizeof(std::int16_t));
  const Result<std::vector<std::uint8_t>> packed = gzip(bytes);
  if (!packed) return packed.error();
  return write_file_atomically(file, *packed);
}

std::string nifti_library_version() {
  return std::string("libnifti2, zlib ") + zlibVersion();
}

}  // namespace trocar::sample
