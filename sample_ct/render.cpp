// SPDX-License-Identifier: Apache-2.0
#include "sample_ct/render.h"

#include <thread>

#include "sample_ct/random.h"

namespace trocar::sample {
namespace {

// The noise kernel along a row and along a column, before scaling: [1 4 1].
constexpr double kKernelSide = 1, kKernelMiddle = 4;

// The distance to the bone's inner surface changes by at most this factor times the motion of the
// point; the factor is above 1 because the shell's thickness varies.
constexpr double kInnerLipschitz = 1.4;

/// Radius within which surfaces influence a pixel: aperture radius plus blur radius.
double reach_mm(const PhantomOptions& phantom, const ScanGeometry& scan) {
  return blur_radius_mm(phantom) + kInnerLipschitz * aperture_radius_mm(scan);
}

/// A pixel's fraction of bone, given the bone at its centre.
BoneFractions pixel_fractions(const PhantomOptions& phantom, const ScanGeometry& scan, Vec3 centre,
                              const BoneSample& bone, double reach) {
  const double inner = bone.distance_mm + bone.cortical_mm;
  if (bone.distance_mm > reach) return {0, 0};
  if (inner < -reach) return {1, 1};
  if (bone.distance_mm < -reach && inner > reach) return {1, 0};
  return aperture_mean<BoneFractions>(
      scan, centre, [&](Vec3 p) { return blurred_fractions(phantom, sample_bone(phantom, p)); });
}

double pixel_hu(const PhantomOptions& phantom, BoneFractions fraction, Vec3 centre) {
  const double soft = fraction.bone < 1 ? soft_tissue_hu(phantom, centre) : 0;
  const double core = fraction.core > 0 ? cancellous_hu(phantom, centre) : 0;
  return mixed_hu(phantom, fraction, soft, core);
}

}  // namespace

Result<ScanGeometry> sample_geometry(int size, int slices) {
  if (size < kMinSize || size > kMaxSize)
    return usage("size " + std::to_string(size) + " is outside " + std::to_string(kMinSize) + ".." +
                 std::to_string(kMaxSize) + " pixels");
  if (slices < kMinSlices || slices > kMaxSlices)
    return usage("slices " + std::to_string(slices) + " is outside " + std::to_string(kMinSlices) +
                 ".." + std::to_string(kMaxSlices));
  ScanGeometry scan;
  scan.columns = scan.rows = size;
  scan.slices = slices;
  // Nine decimals, so that DICOM's decimal strings hold the geometry exactly.
  const auto rounded = [](double mm) { return std::round(mm * 1e9) / 1e9; };
  scan.pixel_mm = rounded(kFieldOfView_mm / size);
  const double half = 0.5 * (kFieldOfView_mm - scan.pixel_mm);
  scan.first_pixel_mm = {rounded(-half), rounded(25.0 - half),
                         -0.5 * (slices - 1) * scan.slice_step_mm};
  return scan;
}

Vec3 pixel_centre_mm(const ScanGeometry& scan, double i, double j, double k) {
  return scan.first_pixel_mm + Vec3{i * scan.pixel_mm, j * scan.pixel_mm, k * scan.slice_step_mm};
}

double aperture_radius_mm(const ScanGeometry& scan) {
  return 0.5 * std::sqrt(2 * scan.pixel_mm * scan.pixel_mm +
                         scan.slice_thickness_mm * scan.slice_thickness_mm);
}

double scanner_hu(const PhantomOptions& phantom, const ScanGeometry& scan, Vec3 centre) {
  const BoneFractions fraction =
      pixel_fractions(phantom, scan, centre, sample_bone(phantom, centre), reach_mm(phantom, scan));
  return pixel_hu(phantom, fraction, centre);
}

std::vector<double> render_slice(const PhantomOptions& phantom, const ScanGeometry& scan, int k) {
  const double reach = reach_mm(phantom, scan);
  std::vector<double> hu;
  hu.reserve(static_cast<std::size_t>(scan.rows) * scan.columns);
  for (int j = 0; j < scan.rows; ++j) {
    BoneSample bone;
    int known_until = 0;  // up to this column the last bone sample is sufficient
    for (int i = 0; i < scan.columns; ++i) {
      const Vec3 centre = pixel_centre_mm(scan, i, j, k);
      if (i >= known_until) {
        bone = sample_bone(phantom, centre);
        // Distances change by at most the distance moved. So if a pixel is far from every surface,
        // so are the next few pixels of the row.
        const double spare =
            std::max(bone.distance_mm - reach,
                     (-bone.distance_mm - bone.cortical_mm - reach) / kInnerLipschitz);
        known_until = i + 1 + static_cast<int>(std::max(spare, 0.0) / scan.pixel_mm);
      }
      hu.push_back(pixel_hu(phantom, pixel_fractions(phantom, scan, centre, bone, reach), centre));
    }
  }
  return hu;
}

std::vector<double> noise_slice(const ScanGeometry& scan, std::uint64_t seed, double sigma_hu,
                                int k) {
  const int columns = scan.columns, rows = scan.rows, wide = columns + 2;
  const std::uint64_t slice_seed = hash_at(seed, 0x6e6f697365, k, 0);
  // White noise with a border of one pixel, smoothed along the rows and then along the columns.
  std::vector<double> smooth(static_cast<std::size_t>(rows + 2) * columns);
  std::vector<double> white(static_cast<std::size_t>(wide));
  for (int j = 0; j < rows + 2; ++j) {
    for (int i = 0; i < wide; ++i)
      white[i] = nearly_normal(mix64(slice_seed + static_cast<std::uint64_t>(j) * wide + i));
    for (int i = 0; i < columns; ++i)
      smooth[static_cast<std::size_t>(j) * columns + i] =
          kKernelSide * (white[i] + white[i + 2]) + kKernelMiddle * white[i + 1];
  }
  constexpr double kPower = 2 * kKernelSide * kKernelSide + kKernelMiddle * kKernelMiddle;
  const double scale = sigma_hu / kPower;  // sqrt(kPower) for each of the two directions
  std::vector<double> noise(static_cast<std::size_t>(rows) * columns);
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < columns; ++i) {
      const std::size_t at = static_cast<std::size_t>(j) * columns + i;
      noise[at] = scale * (kKernelSide * (smooth[at] + smooth[at + std::size_t{2} * columns]) +
                           kKernelMiddle * smooth[at + columns]);
    }
  return noise;
}

Scan render_scan(const PhantomOptions& phantom, const ScanGeometry& geometry, double noise_hu,
                 int threads, const std::atomic<bool>* stop) {
  const std::size_t pixels = static_cast<std::size_t>(geometry.rows) * geometry.columns;
  Scan scan{geometry, phantom.seed, noise_hu, {}};
  scan.hu.resize(pixels * geometry.slices);

  std::atomic<int> next{0};
  const auto work = [&] {
    for (int k = next++; k < geometry.slices; k = next++) {
      if (stop != nullptr && stop->load()) return;
      const std::vector<double> hu = render_slice(phantom, geometry, k);
      const std::vector<double> noise = noise_slice(geometry, phantom.seed, noise_hu, k);
      std::int16_t* out = scan.hu.data() + pixels * k;
      for (std::size_t at = 0; at < pixels; ++at)
        out[at] = static_cast<std::int16_t>(
            std::clamp<long>(std::lround(hu[at] + noise[at]), kMinHu, kMaxHu));
    }
  };
  if (threads <= 0) threads = static_cast<int>(std::thread::hardware_concurrency());
  threads = std::clamp(threads, 1, geometry.slices);
  std::vector<std::thread> crew;
  for (int t = 1; t < threads; ++t)
    crew.emplace_back(work);
  work();
  for (std::thread& thread : crew)
    thread.join();
  return scan;
}

}  // namespace trocar::sample
