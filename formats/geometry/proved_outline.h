// SPDX-License-Identifier: Apache-2.0
// An outline that check_pslg() has accepted. The type shows that it need not be proved again.
// Tests: tests/formats/geometry/mesh_validity_test.cpp
#pragma once

#include <utility>

#include "formats/base/result.h"
#include "formats/geometry/slice_mesh.h"

namespace trocar {

class ProvedOutline {
 public:
  /// The empty outline.
  ProvedOutline() = default;
  /// Errors: those of check_pslg() (mesh_validity.h). O(n log n).
  static Result<ProvedOutline> of(Pslg pslg);

  const Pslg& pslg() const { return pslg_; }

 private:
  explicit ProvedOutline(Pslg pslg) : pslg_(std::move(pslg)) {}
  Pslg pslg_;
};

}  // namespace trocar
