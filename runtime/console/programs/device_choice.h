// SPDX-License-Identifier: Apache-2.0
// The devices that a page may choose. The person who starts trocar-console lists devices by the
// option --device. A page chooses one of these devices by its name or its index in the list, or one
// of Trocar's two simulated devices by its name. It can never choose another URI, a file or option.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar::runtime {

/// The names of the two devices that Trocar itself simulates. kInProcess: trocar-run simulates the
/// device. kSimulator: the console starts a separate process that simulates the device.
inline constexpr const char *kInProcess = "inproc", *kSimulator = "sim";

struct DeviceChoice {
  std::string name = kInProcess;   ///< kInProcess, kSimulator or a URI; pages show it
  std::vector<std::string> words;  ///< options for trocar-run, such as "--key-file", "FILE"

  bool has(std::string_view word) const;
  /// True if Trocar itself simulates the device, or if `words` contains --simulated.
  bool is_simulated() const;
  /// True unless Trocar itself simulates the device (kInProcess, kSimulator).
  bool can_be_tested() const { return name != kInProcess && name != kSimulator; }
};

/// Reads a device and its options, written as
/// "URI[,key-file=FILE][,device-description=FILE][,force-limit=N][,force-scale=F][,simulated]".
/// The values are not checked here; trocar-run checks them. Errors: kUsage if an option is unknown,
/// repeated or without its value.
Result<DeviceChoice> parse_device_choice(std::string_view text);

/// Replaces texts that pages must not see, such as names of folders. Apply hide() to each text that
/// may contain them before the text is sent to pages.
class HiddenTexts {
 public:
  /// Makes hide() replace `text` by `shown`.
  void add(const std::string& text, const std::string& shown);
  /// Makes hide() replace each value of the device's options that contains a /, and so names a
  /// folder, by a text such as "the file of key-file".
  void add(const DeviceChoice& device);
  std::string hide(std::string text) const;

 private:
  struct Entry {
    std::string text, shown;
  };
  std::vector<Entry> entries_;  ///< longest text first, because a text may contain another
};

}  // namespace trocar::runtime
