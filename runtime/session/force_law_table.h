// SPDX-License-Identifier: Apache-2.0
// The table of force laws, from which a session creates the law that its scene names. To add a law
// to the program, follow ARCHITECTURE.md, "A force law". A test calls add_force_law() instead.
#pragma once

#include <memory>

#include "formats/base/result.h"
#include "formats/session/scene.h"
#include "runtime/haptics/force_law.h"

namespace trocar::runtime {

using ForceLawFactory = Result<std::unique_ptr<ForceLaw>> (*)(const ForceLawSetup& setup);

/// Creates the scene's force law. Errors are those of the law's factory.
Result<std::unique_ptr<ForceLaw>> make_force_law(const ForceLawSetup& setup);

/// Adds a law to the table, so that scenes can name the law. Returns its kind. Precondition: no
/// other thread uses the table. `traits.name` is not copied and must outlive all uses of the table.
ForceLawKind add_force_law(const ForceLawTraits& traits, ForceLawFactory factory);

}  // namespace trocar::runtime
