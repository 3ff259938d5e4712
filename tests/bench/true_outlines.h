// SPDX-License-Identifier: GPL-3.0-or-later
// Slices with their true outlines, and the distance of an outline from the true one.
#pragma once

#include <filesystem>
#include <vector>

#include "formats/mesh/slice_mesh.h"
#include "sample_ct/cross_section.h"
#include "tests/support/memory_stack.h"

namespace trocar::pipeline::bench {

inline constexpr double kIso_HU = 226;

struct Truth {
  explicit Truth(sample::CrossSection truth) : section(std::move(truth)), distance(section) {}
  sample::CrossSection section;  ///< mm in the slice's plane
  sample::SectionDistance distance;
};

struct TrueScan {
  MemoryStack stack;  ///< in memory: times contain neither disk nor decoder
  std::vector<Truth> truths;
  double pixel_mm = 0;
  /// 1 by default. Moved to the middle of the widest gap between the areas of true rings of 0.9 to
  /// 1.1 mm^2: a ring that is dropped on one lattice and kept on another would change distances by
  /// centimetres.
  double min_region_mm2 = 1;
};

/// Slices of the sample's phantom, 512 x 512: unrounded without noise, whole HU with noise. True is
/// where a noiseless scanner reads the iso-value; about 1 s a slice, once per slice and process.
TrueScan phantom_scan(const std::vector<int>& slices, double noise_HU);

/// Every `stride`-th slice of a scan. The sub-pixel contour at full resolution on the finest lattice
/// counts as true.
TrueScan file_scan(const std::filesystem::path& path, int stride);

struct OutlineErrors {
  double mean_mm = 0;       ///< mean of the two directed means
  double hausdorff_mm = 0;  ///< greater of the two directed maxima
  double area = 0;          ///< area / truth - 1 over all slices
};
/// Sampled eight times a pixel along both curves, and at all vertices. Slices with an outline on one
/// side only are left out.
OutlineErrors outline_errors(const std::vector<Pslg>& outlines, const Lattice& lattice,
                             const TrueScan& scan);

}  // namespace trocar::pipeline::bench
