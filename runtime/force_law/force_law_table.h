// SPDX-License-Identifier: Apache-2.0
// The table of force laws. README.md of this folder explains how to add a law to the program. Tests
// add a law with add_force_law().
#pragma once

#include <memory>

#include "formats/base/result.h"
#include "formats/session/force_law_kind.h"
#include "runtime/contact/force_law.h"

namespace trocar::runtime {

using ForceLawFactory = Result<std::unique_ptr<ForceLaw>> (*)(const ForceLawSetup& setup);

/// Creates the scene's force law. Errors are those of the law's factory.
Result<std::unique_ptr<ForceLaw>> make_force_law(const ForceLawSetup& setup);

/// Adds a law to the table. From then on scenes can name it. Call this at the start of a program, while
/// no other thread reads scenes. `traits.name` must outlive the program's use of the table.
ForceLawKind add_force_law(const ForceLawTraits& traits, ForceLawFactory factory);

}  // namespace trocar::runtime
