// SPDX-License-Identifier: Apache-2.0
// The haptic thread's view of a remesher, for tests that read one sheet at a time.
#pragma once

#include <cstddef>

#include "runtime/session/remesher.h"

namespace trocar::test {

/// Returns the version of a sheet that was published last.
inline const runtime::Sheet* current(runtime::Remesher& remesher, std::size_t sheet) {
  return remesher.current(sheet, remesher.versions_published());
}

}  // namespace trocar::test
