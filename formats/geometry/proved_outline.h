// SPDX-License-Identifier: Apache-2.0
// An outline that is proved valid, for example without edges that cross. A function that takes a
// ProvedOutline need not prove the outline again.
#pragma once

#include <utility>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

class ProvedOutline {
 public:
  /// The empty outline.
  ProvedOutline() = default;
  /// Checks the outline by check_pslg() (mesh_validity.h) and wraps it. Errors: those of
  /// check_pslg(). O(n log n).
  static Result<ProvedOutline> of(Pslg pslg);

  const Pslg& pslg() const { return pslg_; }

 private:
  explicit ProvedOutline(Pslg pslg) : pslg_(std::move(pslg)) {}
  Pslg pslg_;
};

}  // namespace trocar
