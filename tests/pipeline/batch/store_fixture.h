// SPDX-License-Identifier: GPL-3.0-or-later
// What the tests of the store put into one.
#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "pipeline/batch/scan_files.h"
#include "pipeline/batch/store.h"

namespace trocar::farm {

inline std::string text_in(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct Made {
  std::string key;
  Outputs outputs;
};

/// An action with its outputs, which differ by the salt.
inline Made put(const Store& store, const std::string& salt) {
  const nlohmann::json action = {{"salt", salt}};
  Made out{key_of(action),
           {*store.put_content(text_bytes("asset " + salt), {}),
            *store.put_content(text_bytes("report " + salt), {})}};
  EXPECT_TRUE(store.put_action(out.key, action, out.outputs));
  return out;
}

inline ScanEntry done_entry(const std::string& name, const Made& made) {
  ScanEntry out;
  out.name = name;
  out.key = made.key;
  out.program = std::string("p");
  out.parameters = nlohmann::json::object();
  out.outputs = made.outputs;
  return out;
}

}  // namespace trocar::farm
