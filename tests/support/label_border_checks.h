// SPDX-License-Identifier: GPL-3.0-or-later
// Checks of the borders between materials (pipeline/contour/label_borders.h), for the pipeline's
// tests.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/mesh_validity.h"
#include "pipeline/contour/label_borders.h"
#include "pipeline/contour/simplification.h"

namespace trocar::pipeline {

/// Proves in exact integers that no point of the plane is in two materials, and that every point
/// within the outline of the union of all materials is in one. For this the function checks that
/// each material's outline and the union's outline pass check_pslg(), and that the areas of the
/// materials add up to the area of the union. These checks suffice for the following reason. The
/// outlines of two neighbours contain their common chain in opposite directions, so the chain
/// cancels in the sum of all materials' winding numbers. At each point the sum is therefore the
/// winding number of the union's outline, which is 0 or 1. Errors: kBug; the message names the
/// condition that does not hold.
inline Result<void> check_label_borders(const LabelBorders& borders) {
  std::int64_t sum = 0;
  const std::vector<Pslg> outlines = material_outlines(borders);
  for (std::size_t m = 0; m < outlines.size(); ++m) {
    sum += doubled_area(outlines[m]);
    if (auto ok = check_pslg(outlines[m]); !ok)
      return bug("material " + std::to_string(m + 1) + ": " + ok.error().message);
  }
  const Pslg all = outline_of(borders, [](MaterialNumber m) { return m != kNoMaterial; });
  if (auto ok = check_pslg(all); !ok) return bug("all materials: " + ok.error().message);
  if (sum != doubled_area(all)) {
    return bug("the areas of the materials and of all differ by " +
               std::to_string(sum - doubled_area(all)) + " half squared steps");
  }
  return {};
}

/// Two-sided Hausdorff distance between a chain of `full` and the chain of the same index in
/// `simple`, in mm. Returns the largest distance of all chains.
inline double hausdorff_mm(const LabelBorders& full, const LabelBorders& simple,
                           const Lattice& lattice) {
  double worst_mm = 0;
  for (std::size_t c = 0; c < full.chains.size(); ++c) {
    worst_mm =
        std::max(worst_mm, hausdorff_mm({{full.chains[c].points}}, {{simple.chains[c].points}},
                                        lattice, {!full.chains[c].is_closed}));
  }
  return worst_mm;
}

}  // namespace trocar::pipeline
