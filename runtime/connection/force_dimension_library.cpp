// SPDX-License-Identifier: Apache-2.0
#include "runtime/connection/force_dimension_library.h"

#include <dlfcn.h>

#include <array>
#include <cstdlib>
#include <string>

#include "runtime/connection/foreign_text.h"

namespace trocar::runtime {
namespace {

// The SDK contains libdhd.so.3.x.y; ldconfig or the user makes the shorter names. libdrd contains libdhd's functions too.
constexpr std::array kLibraryNames{"libdhd.so.3", "libdhd.so", "libdrd.so.3", "libdrd.so"};

struct LoadedLibrary {
  void* handle = nullptr;
  std::string name;
};

void* load_library(const char* name) {
  return ::dlopen(name, RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
}

std::string load_error() {
  return foreign_text(::dlerror());  // NOLINT(concurrency-mt-unsafe) glibc keeps it for each thread
}

Result<LoadedLibrary> find_library() {
  const char* const named = std::getenv(kForceDimensionVariable);  // NOLINT(concurrency-mt-unsafe)
  if (named != nullptr && *named != '\0') {
    if (void* const handle = load_library(named)) return LoadedLibrary{handle, named};
    return sdk_error("the library named by " + std::string(kForceDimensionVariable) +
                     " cannot be loaded: " + load_error());
  }
  for (const char* const name : kLibraryNames) {
    if (void* const handle = load_library(name)) return LoadedLibrary{handle, name};
    // A library that is there but cannot be loaded, for example without libusb, is worth its message.
    const std::string why = load_error();
    if (!why.starts_with(std::string(name) + ": cannot open shared object file")) {
      return sdk_error("Force Dimension's library " + std::string(name) +
                       " cannot be loaded: " + why);
    }
  }
  return sdk_error(
      "Force Dimension's library (libdhd.so.3) was not found; install the SDK from "
      "forcedimension.com, then run ldconfig or name its libdhd.so.3.* in the environment "
      "variable " +
      std::string(kForceDimensionVariable));
}

/// Sets `function` to the library's function of that name, and `missing` if there is none.
template <typename Function>
void find_function(const LoadedLibrary& library, const char* name, Function*& function,
                   const char*& missing) {
  function = reinterpret_cast<Function*>(::dlsym(library.handle, name));
  if (function == nullptr && missing == nullptr) missing = name;
}

}  // namespace

Result<ForceDimensionLibrary> load_force_dimension_library() {
  const Result<LoadedLibrary> library = find_library();
  if (!library) return library.error();
  ForceDimensionLibrary f{};
  const char* missing = nullptr;
  find_function(*library, "dhdErrorGetLastStr", f.error_get_last_str, missing);
  find_function(*library, "dhdGetDeviceCount", f.get_device_count, missing);
  find_function(*library, "dhdOpen", f.open, missing);
  find_function(*library, "dhdOpenID", f.open_id, missing);
  find_function(*library, "dhdClose", f.close, missing);
  find_function(*library, "dhdGetSystemName", f.get_system_name, missing);
  find_function(*library, "dhdGetStatus", f.get_status, missing);
  find_function(*library, "dhdHasWrist", f.has_wrist, missing);
  find_function(*library, "dhdHasActiveWrist", f.has_active_wrist, missing);
  find_function(*library, "dhdEnableForce", f.enable_force, missing);
  find_function(*library, "dhdGetPosition", f.get_position, missing);
  find_function(*library, "dhdGetPositionAndOrientationFrame", f.get_position_and_orientation_frame,
                missing);
  find_function(*library, "dhdGetButtonMask", f.get_button_mask, missing);
  find_function(*library, "dhdSetForce", f.set_force, missing);
  find_function(*library, "dhdSetForceAndTorque", f.set_force_and_torque, missing);
  const char* not_needed = nullptr;
  find_function(*library, "dhdGetSerialNumber", f.get_serial_number, not_needed);
  if (missing != nullptr) {
    return sdk_error("the library " + library->name + " has no function " + missing +
                     "; install release 3.16 or later of Force Dimension's SDK");
  }
  return f;
}

}  // namespace trocar::runtime
