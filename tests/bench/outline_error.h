// SPDX-License-Identifier: GPL-3.0-or-later
// The distance of an outline from the true one, in both directions, by dense sampling.
#pragma once

#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "sample_ct/cross_section.h"

namespace trocar::pipeline::bench {

/// An outline in mm in its slice plane, in the type that SectionDistance takes.
sample::CrossSection as_section(const Pslg& outline, const Lattice& lattice);

/// The true outline of one slice, which may be empty.
struct Truth {
  explicit Truth(sample::CrossSection truth);
  sample::CrossSection section;
  sample::SectionDistance distance;
};

/// Results over any number of slices.
struct ErrorSamples {
  std::vector<float> outline_to_truth_mm;  ///< at equal steps of arc length, without vertices
  std::vector<float> truth_to_outline_mm;
  double outline_to_truth_max_mm = 0;  ///< over samples and vertices
  double truth_to_outline_max_mm = 0;
  double area_mm2 = 0, truth_area_mm2 = 0;
  double worst_area_error = 0;  ///< largest |area / truth - 1| of a slice
  int unmatched = 0;            ///< slices with material in only one of the two: not measured
};

/// Adds one slice. Distances are sampled every `step_mm` along both curves and at all vertices. A
/// distance is 1-Lipschitz, so the error of a maximum is at most step_mm / 2.
void add_errors(const sample::CrossSection& outline, const Truth& truth, double step_mm,
                ErrorSamples& into);

struct ErrorSummary {
  double hausdorff_mm = 0;  ///< the greater of the two directed maxima
  double mean_mm = 0;       ///< mean of the two directed means
  double p99_mm = 0;        ///< 99th percentile of the samples of both directions
  double area_error = 0;    ///< area / truth - 1 over all slices, signed
};
ErrorSummary summarise(const ErrorSamples& samples);

}  // namespace trocar::pipeline::bench
