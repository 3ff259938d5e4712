// SPDX-License-Identifier: Apache-2.0
// An outline that check_pslg() has accepted: who is given one need not prove it again.
#pragma once

#include <utility>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

class ProvedOutline {
 public:
  /// Of nothing.
  ProvedOutline() = default;
  /// Errors: those of check_pslg() (mesh_validity.h). O(n log n).
  static Result<ProvedOutline> of(Pslg pslg);

  const Pslg& pslg() const { return pslg_; }

 private:
  explicit ProvedOutline(Pslg pslg) : pslg_(std::move(pslg)) {}
  Pslg pslg_;
};

}  // namespace trocar
