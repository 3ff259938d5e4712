// SPDX-License-Identifier: Apache-2.0
// Messages of the Haply Inverse service, written from its documentation.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "formats/base/files.h"

namespace trocar::runtime {

inline std::string haply_text(const char* name) {
  const auto bytes = read_file(std::string(TROCAR_CORPUS) + "/haply/" + name);
  EXPECT_TRUE(bytes) << name;
  return bytes ? std::string(bytes->begin(), bytes->end()) : "";
}

inline const std::string kInventory35 = haply_text("inventory_3_5.json");
inline const std::string kUpdate35 = haply_text("state_3_5.json");
inline const std::string kInventory31 = haply_text("inventory_3_1.json");
inline const std::string kUpdate31 = haply_text("state_3_1.json");

}  // namespace trocar::runtime
