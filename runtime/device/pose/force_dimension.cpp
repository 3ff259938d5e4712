// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/force_dimension.h"

#include <dlfcn.h>
#include <charconv>
#include <cstdlib>

#include "formats/base/text.h"

namespace trocar::runtime {

// The functions and types follow the SDK's public list of functions (SDK 3.16). For example,
// get_status is the SDK's dhdGetStatus.

/// The SDK's functions. `id` is the number of a device that open() or open_id() has returned. A
/// negative result is an error. error_get_last_str(), called in the same thread, then returns
/// the error's text. Results above 0 are not errors. A function that measures returns
/// kSameMeasurement if the SDK gave its last measurement again, because that measurement is recent
/// enough. A function that sets forces returns 2 if a motor cannot give the whole force.
struct ForceDimensionLibrary {
  const char* (*error_get_last_str)();
  int (*get_device_count)();
  int (*open)();
  int (*open_id)(char index);
  int (*close)(char id);
  const char* (*get_system_name)(char id);
  int (*get_serial_number)(std::uint16_t* number, char id);  ///< null if the library has none
  int (*get_status)(int* status, char id);
  bool (*has_wrist)(char id);
  bool (*has_active_wrist)(char id);
  int (*enable_force)(unsigned char enable, char id);
  int (*get_position)(double* x_m, double* y_m, double* z_m, char id);
  int (*get_position_and_orientation_frame)(double* x_m, double* y_m, double* z_m,
                                            double (*frame)[3], char id);
  unsigned (*get_button_mask)(char id);
  int (*set_force)(double x_N, double y_N, double z_N, char id);
  int (*set_force_and_torque)(double x_N, double y_N, double z_N, double x_Nm, double y_Nm,
                              double z_Nm, char id);
};

namespace {

/// The result of a function that measures if the SDK gave its last measurement again.
constexpr int kSameMeasurement = 1;
/// Index of the entry for calibration in the array of get_status(): 0 if the device is calibrated.
constexpr int kStatusReset = 3;
/// Length of the array for get_status(), which is more than any release of the SDK fills.
constexpr int kStatusLength = 64;

/// Returns an error of the library or of a device, without the device's URI, which the caller adds.
Error sdk_error(std::string message) {
  return {ExitCode::kDeviceFault, std::move(message)};
}

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

/// Loads the library for the rest of the process. The library is never unloaded, because it starts
/// threads, and because a call that hangs would later return into unloaded code. Errors:
/// kDeviceFault if the library or one of its functions is missing, or if the library cannot be
/// loaded. The message says what to install or what is wrong.
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

constexpr int kMaxDeviceIndex = 15;
constexpr double kMaxOriginDistance_m = 10;
constexpr double kOrthonormalTolerance = 1e-3;
constexpr double kOpenCallTimeout_s =
    kOpenTimeout_s - CallThread::kPatience_s;  // the rest is for close()

using OrientationFrame = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

/// The SDK's message for a function of this thread that has returned `code`.
Error failed_call(const ForceDimensionLibrary& sdk, const char* function, int code) {
  return sdk_error(text_line("%s failed: %s (%d)", function,
                             foreign_text(sdk.error_get_last_str()).c_str(), code));
}

bool is_rotation(const OrientationFrame& frame) {
  return frame.allFinite() && frame.determinant() > 0 &&
         (frame.transpose() * frame - OrientationFrame::Identity()).cwiseAbs().maxCoeff() <=
             kOrthonormalTolerance;
}

/// The result of opening a device.
struct FoundDevice {
  std::vector<std::string> lines;  ///< tell the operator what was found
  bool senses_rotation = false;
  bool renders_moment = false;
};

}  // namespace

struct ForceDimension::Device {
  std::optional<ForceDimensionLibrary> sdk;
  std::optional<char> id;  ///< the open device
  std::string identity;    ///< name and serial number of the first device opened; empty: none yet
  bool senses_rotation = false;
  bool renders_moment = false;
  bool has_active_wrist = false;
  std::optional<double> measured_t_s;  ///< time of the last measurement since open()
  FaultDetail refused;                 ///< of the last exchange()

  Result<FoundDevice> open(int index, bool wants_rotation, bool wants_moment);
  Result<PoseReading> exchange(const HandleWrench& wrench);
  void close();

 private:
  std::string identity_of_open() const;
  Result<void> choose(int index, int count);
  Result<FoundDevice> open_device(int index, bool wants_rotation, bool wants_moment);
  Result<void> command(const HandleWrench& wrench, bool with_moment) const;
};

Result<FoundDevice> ForceDimension::Device::open(int index, bool wants_rotation,
                                                 bool wants_moment) {
  close();  // an open() whose caller has given up may have opened it
  if (const auto ok = load_force_dimension_library().into(sdk); !ok) return ok.error();
  Result<FoundDevice> found = open_device(index, wants_rotation, wants_moment);
  if (found)
    identity = identity_of_open();
  else
    close();
  return found;
}

std::string ForceDimension::Device::identity_of_open() const {
  const std::string name = foreign_text(sdk->get_system_name(*id));
  std::uint16_t number = 0;
  const bool has_number =
      sdk->get_serial_number != nullptr && sdk->get_serial_number(&number, *id) >= 0;
  return has_number ? name + text_line(" with the serial number %d", int{number}) : name;
}

/// Opens the device that was opened before, or else the one with this index.
Result<void> ForceDimension::Device::choose(int index, int count) {
  if (identity.empty()) {
    if (index >= count) {
      return sdk_error(
          text_line("there is no device %d; %d connected, counted from 0", index, count));
    }
    const int opened = index < 0 ? sdk->open() : sdk->open_id(static_cast<char>(index));
    if (opened < 0) return failed_call(*sdk, index < 0 ? "dhdOpen" : "dhdOpenID", opened);
    id = static_cast<char>(opened);
    return {};
  }
  for (int i = 0; i < count; ++i) {
    const int opened = sdk->open_id(static_cast<char>(i));
    if (opened < 0) continue;  // it is in use, or has just been disconnected
    id = static_cast<char>(opened);
    if (identity_of_open() == identity) return {};
    (void)sdk->close(*id);
    id.reset();
  }
  return sdk_error("the session's device (" + identity +
                   ") is not connected, or another program uses it; connect it again");
}

Result<FoundDevice> ForceDimension::Device::open_device(int index, bool wants_rotation,
                                                        bool wants_moment) {
  const int count = sdk->get_device_count();
  if (count < 0) return failed_call(*sdk, "dhdGetDeviceCount", count);
  if (count == 0) {
    return sdk_error(
        "no device is connected; check its power and its USB cable, and that you may use the USB "
        "device (a udev rule for vendor 1451)");
  }
  const bool is_first = identity.empty();
  if (Result<void> chosen = choose(index, count); !chosen) return chosen.error();

  has_active_wrist = sdk->has_active_wrist(*id);
  senses_rotation = wants_rotation && sdk->has_wrist(*id);
  renders_moment = wants_moment && has_active_wrist;
  std::array<int, kStatusLength> status{};
  if (const int code = sdk->get_status(status.data(), *id); code < 0)
    return failed_call(*sdk, "dhdGetStatus", code);
  if (status[kStatusReset] != 0) {
    return sdk_error(
        "the device is not calibrated, so its position is unknown; put its handle to the rest "
        "position, as its manual says");
  }
  if (const int code = sdk->enable_force(1, *id); code < 0)
    return failed_call(*sdk, "dhdEnableForce", code);
  if (Result<void> none = command({}, has_active_wrist); !none) return none.error();

  FoundDevice found{{}, senses_rotation, renders_moment};
  found.lines.push_back(foreign_text(sdk->get_system_name(*id)) + " found" +
                        (senses_rotation ? "" : "; its orientation is not measured") +
                        (renders_moment ? "" : "; moments are not rendered"));
  if (is_first && index < 0 && count > 1) {
    found.lines.push_back(text_line(
        "%d devices are connected; the first free one is used, and an index in the URI names one",
        count));
  }
  return found;
}

Result<void> ForceDimension::Device::command(const HandleWrench& wrench, bool with_moment) const {
  const auto& [fx, fy, fz, tx, ty, tz] = wrench;
  const int code = with_moment ? sdk->set_force_and_torque(fx, fy, fz, tx, ty, tz, *id)
                               : sdk->set_force(fx, fy, fz, *id);
  if (code < 0)
    return failed_call(*sdk, with_moment ? "dhdSetForceAndTorque" : "dhdSetForce", code);
  return {};
}

Result<PoseReading> ForceDimension::Device::exchange(const HandleWrench& wrench) {
  refused = {};
  if (!id) return sdk_error("the device is not open");
  for (const double value : wrench) {
    if (!std::isfinite(value)) return sdk_error("a command that is not finite was not sent");
  }
  if (Result<void> sent = command(wrench, renders_moment); !sent) return sent.error();

  PoseReading reading;
  OrientationFrame frame = OrientationFrame::Identity();
  auto& [x, y, z] = reading.p_m;
  const char* function = "dhdGetPosition";
  int code = 0;
  if (senses_rotation) {
    double rows[3][3] = {};
    function = "dhdGetPositionAndOrientationFrame";
    code = sdk->get_position_and_orientation_frame(&x, &y, &z, rows, *id);
    frame = Eigen::Map<const OrientationFrame>(&rows[0][0]);
  } else {
    code = sdk->get_position(&x, &y, &z, *id);
  }
  if (code != kSameMeasurement || !measured_t_s) {
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    measured_t_s = std::chrono::duration<double>(now).count();
  }
  reading.t_s = *measured_t_s;
  if (code < 0) return failed_call(*sdk, function, code);
  // Written so that NaN fails.
  if (!(std::hypot(x, y, z) <= kMaxOriginDistance_m)) {
    constexpr double kLargest_m = kMaxOriginDistance_m / std::numbers::sqrt3;
    int worst = 0;  // NaN is worse than any number
    for (int i = 1; i < 3; ++i) {
      const double least_m = std::abs(reading.p_m[static_cast<std::size_t>(worst)]);
      if (!(std::abs(reading.p_m[static_cast<std::size_t>(i)]) <= least_m)) worst = i;
    }
    const double at_m = reading.p_m[static_cast<std::size_t>(worst)];
    refused = {Fault::kRefusedState, FaultQuantity::kMeasuredPosition, worst, at_m,
               std::copysign(kLargest_m, at_m)};
    return sdk_error(text_line("%s returned no usable position: %g %g %g m", function, x, y, z));
  }
  if (!is_rotation(frame)) {
    refused = {Fault::kRefusedState, FaultQuantity::kMeasuredRotation, -1, frame.determinant(), 1};
    return sdk_error(text_line("%s returned an orientation frame that is no rotation", function));
  }
  const Eigen::Quaterniond q = Eigen::Quaterniond(Eigen::Matrix3d(frame)).normalized();
  reading.q = {q.w(), q.x(), q.y(), q.z()};
  reading.buttons = sdk->get_button_mask(*id);
  return reading;
}

void ForceDimension::Device::close() {
  if (!id) return;
  // Each of them even if the one before has failed. Nobody can do more about an error here.
  (void)command({}, has_active_wrist);
  (void)sdk->enable_force(0, *id);
  (void)sdk->close(*id);
  id.reset();
  measured_t_s.reset();
}

Result<int> parse_force_dimension_address(std::string_view address) {
  if (address.empty()) return -1;
  int id = -1;
  const char* const end = address.data() + address.size();
  const auto [stop, error] = std::from_chars(address.data(), end, id);
  if (error != std::errc() || stop != end || address.front() == '-' || id > kMaxDeviceIndex) {
    return usage("forcedimension:" + foreign_text(address, 40) +
                 ": after the colon stands nothing, or the index of a device, 0 to " +
                 std::to_string(kMaxDeviceIndex));
  }
  return id;
}

ForceDimension::ForceDimension(ForceDimensionOptions options)
    : options_(std::move(options)),
      uri_("forcedimension:" + (options_.id < 0 ? "" : std::to_string(options_.id) + ":")),
      device_(std::make_shared<Device>()) {}

ForceDimension::~ForceDimension() {
  close();
}

Error ForceDimension::fault(const std::string& message) const {
  return {ExitCode::kDeviceFault, uri_ + " " + message};
}

Result<void> ForceDimension::open() {
  const auto found = calls_.call(
      [device = device_, index = options_.id, rotation = options_.wants_rotation,
       moment = options_.wants_moment] { return device->open(index, rotation, moment); },
      kOpenCallTimeout_s);
  if (!found) {
    close();  // at last, if a call returns later
    return fault(text_line("the SDK has not answered for %g s; switch the device off and on",
                           kOpenCallTimeout_s));
  }
  if (!*found) return fault(found->error().message);
  senses_rotation_ = (*found)->senses_rotation;
  renders_moment_ = (*found)->renders_moment;
  for (const std::string& line : (*found)->lines) {
    if (options_.say) options_.say(uri_ + " " + line);
  }
  const bool lacks_rotation = options_.wants_rotation && !senses_rotation_;
  if (options_.needs_all && (lacks_rotation || (options_.wants_moment && !renders_moment_))) {
    return fault(lacks_rotation
                     ? "the device does not measure the orientation of its handle, and its "
                       "description says that it does (senses_rotation)"
                     : "the device renders no moment, and its description says that it does "
                       "(moment_max_Nm)");
  }
  return {};
}

Result<PoseReading> ForceDimension::exchange(const HandleWrench& wrench) {
  auto reading = calls_.call([device = device_, wrench] { return device->exchange(wrench); },
                             kExchangeTimeout_s);
  if (!reading) {
    refused_ = {};
    return fault(text_line("the SDK has not answered for %g ms", 1e3 * kExchangeTimeout_s));
  }
  refused_ = device_->refused;  // its call has ended
  if (!*reading) return fault(reading->error().message);
  return **reading;
}

void ForceDimension::close() noexcept {
  calls_.call_at_last([device = device_] { device->close(); });
}

}  // namespace trocar::runtime
