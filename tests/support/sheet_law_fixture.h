// SPDX-License-Identifier: Apache-2.0
// Force laws of separate sheets for tests that run the haptic loop without a session.
#pragma once

#include "runtime/haptics/loop/haptic_loop.h"
#include "runtime/haptics/membrane/sheet_law.h"

namespace trocar::test {

/// The force law `hooke` with the loop's tool.
inline runtime::SheetLaw hooke_law(const runtime::LoopModel& model,
                                   const runtime::CouplingOptions& coupling = {}) {
  runtime::ContactModel contact;
  contact.tool = model.tool;
  contact.dt_s = 1 / model.rate_Hz;
  return runtime::SheetLaw(contact, coupling);
}

/// The contact of the force law `network`, without a prefetch worker.
inline runtime::SheetLaw network_law(const runtime::LoopModel& model) {
  runtime::ContactModel contact;
  contact.tool = model.tool;
  contact.uses_prefetched_stiffness = true;
  return runtime::SheetLaw(contact);
}

}  // namespace trocar::test
