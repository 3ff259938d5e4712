// SPDX-License-Identifier: Apache-2.0
// The scanner: samples the phantom's field as slices of integer HU.
//
// The HU of a pixel follow from the mean volume fraction of bone over the pixel's area and the
// slice's thickness (partial volume). Near the bone's outer or inner surface this mean is computed
// from several samples, elsewhere from one sample. Textures vary little over a pixel, so they are
// sampled at the pixel's centre. Last, noise is added, and the sum is rounded to an integer. The
// noise is mildly correlated in the plane, like the noise of a reconstruction kernel.
//
// Results are a pure function of the arguments: they do not depend on the number of threads or the
// order of the slices.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "formats/base/result.h"
#include "sample_ct/phantom.h"

namespace trocar::sample {

/// The grid of a scan, and the box over which each pixel averages. The pixel in column i and row j
/// of slice k has its centre at first_pixel_mm + (i * pixel_mm, j * pixel_mm, k * slice_step_mm) in
/// the scan frame (LPS). So i grows to the patient's left, j to the back, and k upwards.
struct ScanGeometry {
  int columns = 512;
  int rows = 512;
  int slices = 35;
  double pixel_mm = 0.3125;
  double slice_step_mm = 1.0;
  Vec3 first_pixel_mm{-79.84375, -54.84375, -17.0};
  double slice_thickness_mm = 1.0;  ///< 0: infinitely thin slices
  int subsamples_xy = 3;            ///< samples along each edge of a pixel
  int subsamples_z = 3;             ///< samples across the slice's thickness
};

inline constexpr int kMinSize = 32, kMaxSize = 1024;
inline constexpr int kMinSlices = 1, kMaxSlices = 61;
inline constexpr double kFieldOfView_mm = 160.0;
inline constexpr double kMaxNoise_hu = 200.0;

/// The sample scan's geometry: `size` x `size` pixels over a field of view of 160 mm, `slices`
/// slices 1 mm apart, centred on the middle of the vertebral body. Errors: kUsage if a number is
/// outside the limits above.
Result<ScanGeometry> sample_geometry(int size, int slices);

/// Centre of a pixel in the scan frame; i, j, k may be fractional.
Vec3 pixel_centre_mm(const ScanGeometry& scan, double i, double j, double k);

/// The HU that a noiseless scanner with this geometry measures in a pixel at any `centre` in the
/// scan frame. Near the bone's surface the HU are a smooth function of `centre`.
double scanner_hu(const PhantomOptions& phantom, const ScanGeometry& scan, Vec3 centre);

/// Radius of the smallest ball around a pixel's centre that contains the pixel's aperture. The
/// aperture is a box with the pixel's area and the slice's thickness.
double aperture_radius_mm(const ScanGeometry& scan);

/// One slice of noiseless, unrounded HU, rows * columns values, row by row.
std::vector<double> render_slice(const PhantomOptions& phantom, const ScanGeometry& scan, int k);

/// Noise of mean 0 and standard deviation sigma_hu, rows * columns values. The correlation of
/// pixels in a row or column is 4/9 for neighbours and 1/18 at a distance of two pixels. It is 0 at
/// larger distances and between slices.
std::vector<double> noise_slice(const ScanGeometry& scan, std::uint64_t seed, double sigma_hu,
                                int k);

/// A scan, the input of write_png(), write_dicom() and write_nifti().
struct Scan {
  ScanGeometry geometry;
  std::uint64_t seed = 1;
  double noise_hu = 12;
  std::vector<std::int16_t> hu;  ///< slices * rows * columns, within kMinHu .. kMaxHu
  const std::int16_t* slice(int k) const {
    return hu.data() + static_cast<std::ptrdiff_t>(k) * geometry.rows * geometry.columns;
  }
};
inline constexpr int kMinHu = -1024, kMaxHu = 3071;

/// Renders the whole scan; phantom.seed is also the seed of the noise. If `threads` is 0 or less,
/// all cores are used. If `*stop` becomes true during the work, the scan may be incomplete.
Scan render_scan(const PhantomOptions& phantom, const ScanGeometry& geometry, double noise_hu,
                 int threads = 0, const std::atomic<bool>* stop = nullptr);

/// The mean of field(Vec3) over the aperture (pixel area and slice thickness) around `centre`, by
/// the midpoint rule, summed in a fixed order. T must have the operators += T and * double.
template <typename T, typename Field>
T aperture_mean(const ScanGeometry& scan, Vec3 centre, const Field& field) {
  const int n = scan.subsamples_xy, m = scan.slice_thickness_mm > 0 ? scan.subsamples_z : 1;
  T sum{};
  for (int c = 0; c < m; ++c)
    for (int b = 0; b < n; ++b)
      for (int a = 0; a < n; ++a)
        sum += field(centre + Vec3{((a + 0.5) / n - 0.5) * scan.pixel_mm,
                                   ((b + 0.5) / n - 0.5) * scan.pixel_mm,
                                   ((c + 0.5) / m - 0.5) * scan.slice_thickness_mm});
  return sum * (1.0 / (n * n * m));
}

}  // namespace trocar::sample
