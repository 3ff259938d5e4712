// SPDX-License-Identifier: GPL-3.0-or-later
// How far an outline lies from the truth, both ways, by dense sampling.
#pragma once

#include <vector>

#include "formats/geometry/slice_mesh.h"
#include "sample_ct/cross_section.h"

namespace trocar::pipeline::bench {

/// An outline in mm of its slice plane, as the type that SectionDistance measures against.
sample::CrossSection as_section(const Pslg& outline, const Lattice& lattice);

/// The truth of one slice. Empty where the slice holds no material.
struct Truth {
  explicit Truth(sample::CrossSection truth);
  sample::CrossSection section;
  sample::SectionDistance distance;
};

/// What was found over any number of slices.
struct ErrorSamples {
  std::vector<float> outline_to_truth_mm;  ///< at equal steps of arc length, vertices left out
  std::vector<float> truth_to_outline_mm;
  double outline_to_truth_max_mm = 0;  ///< over samples and vertices
  double truth_to_outline_max_mm = 0;
  double area_mm2 = 0, truth_area_mm2 = 0;
  double worst_area_error = 0;  ///< largest |area / truth - 1| of a slice
  int unmatched = 0;            ///< slices with material in only one of the two: not measured
};

/// Adds one slice. Distances are read every `step_mm` along both curves and at all vertices;
/// distance being 1-Lipschitz, no maximum is missed by more than step_mm / 2.
void add_errors(const sample::CrossSection& outline, const Truth& truth, double step_mm,
                ErrorSamples& into);

struct ErrorSummary {
  double hausdorff_mm = 0;  ///< the greater of the two directed maxima
  double mean_mm = 0;       ///< mean of the two directed means
  double p99_mm = 0;        ///< of both directions' samples together
  double area_error = 0;    ///< area / truth - 1 over all slices, signed
};
ErrorSummary summarise(const ErrorSamples& samples);

}  // namespace trocar::pipeline::bench
