// SPDX-License-Identifier: Apache-2.0
// The devices that trocar-console --device lists. A page chooses one by its name or its index; it
// never states a URI, a file or an option.
// Tests: tests/runtime/console/device_choice_test.cpp
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The device simulated in trocar-run, and the one simulated by a process that the console starts.
inline constexpr const char *kInProcess = "inproc", *kSimulator = "sim";

struct DeviceChoice {
  std::string name = kInProcess;   ///< kInProcess, kSimulator or a URI; pages show it
  std::vector<std::string> words;  ///< options for trocar-run, such as "--key-file", "FILE"

  bool has(std::string_view word) const;
  bool is_simulated() const;
  /// True for a device outside of the console's own processes.
  bool can_be_tested() const { return name != kInProcess && name != kSimulator; }
};

/// Reads "URI[,key-file=FILE][,device-description=FILE][,force-limit=N][,force-scale=F][,simulated]". Errors: (usage)
/// another or a repeated option, or an option without its value. trocar-run checks the values.
Result<DeviceChoice> parse_device_choice(std::string_view text);

/// Replaces texts, such as names of folders, in what is shown to pages.
class HiddenTexts {
 public:
  void add(const std::string& text, const std::string& shown);
  /// Hides the files that the device's options name, if they are given with a folder.
  void add(const DeviceChoice& device);
  std::string hide(std::string text) const;

 private:
  struct Entry {
    std::string text, shown;
  };
  std::vector<Entry> entries_;  ///< the longest first, because one may begin with another
};

}  // namespace trocar::runtime
