// SPDX-License-Identifier: Apache-2.0
// Finds the tissue of each slice, and states the reason in words.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/session/scene.h"
#include "runtime/contact/tissue_choice.h"

namespace trocar::runtime {

/// Returns a text such as "slice 3" or "slices 0-46, 50", with each slice once, in ascending order.
std::string name_slices(std::vector<int> slices);

struct SliceTissue {
  int slice = 0;  ///< slice index in the asset
  double z_m = 0;
  TissueChoice choice;
};

/// Returns the tissue of every slice of the scene, the topmost first as in place_slices(). Slices
/// that the asset does not have are left out.
std::vector<SliceTissue> choose_tissues(const Scene& scene, const Asset& asset);

/// Returns a text such as: tissue "bone": mean HU 412.
std::string describe_choice(const Scene& scene, const TissueChoice& choice);

/// Returns a warning if some slice gets Trocar's default tissue although the scene gives tissues by
/// label or HU. That happens if none of these tissues fits the slice, and the scene has no `tissue`
/// for the remaining slices.
std::optional<std::string> warn_of_unfitting(const Scene& scene,
                                             const std::vector<SliceTissue>& tissues);

}  // namespace trocar::runtime
