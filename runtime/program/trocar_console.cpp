// SPDX-License-Identifier: Apache-2.0
// The program trocar-console: the command line of the operator's console, which is runtime/console.
#include <unistd.h>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "formats/base/command_line.h"
#include "formats/base/json.h"
#include "runtime/console/access.h"
#include "runtime/console/server.h"
#include "runtime/program/library_versions.h"
#include "runtime/session/open_device.h"

namespace trocar::runtime {
namespace {

constexpr const char* kName = "trocar-console";

struct Arguments {
  std::string folder, public_url, page, igtl, recording, against, scene, start;
  std::vector<std::string> devices;
  ServerSettings server;
};

int fail(const Error& error) {
  return report_error(kName, error);
}

void declare(CLI::App& line, Arguments& arguments) {
  CLI::Option* const folder = line.add_option(
      "FOLDER", arguments.folder,
      "folder of the scenes, assets and recordings to choose from. Sessions are kept in its\n"
      "subfolder sessions/. If FOLDER cannot be written to, or was installed with the program\n"
      "(like /usr/share/trocar/examples), sessions are kept in ~/.local/state/trocar/sessions");
  add_number(line, "--port", arguments.server.port, {0, 65535},
             "TCP port of the page; 0: any free one");
  line.add_option(
          "--listen", arguments.server.listen,
          "IP address to listen on (default: 127.0.0.1); connections from other machines are not\n"
          "encrypted")
      ->type_name("ADDRESS");
  line.add_option(
          "--public-url", arguments.public_url,
          "address of the page through a tunnel or proxy, http://HOST:PORT or https://HOST: the\n"
          "printed links begin with it")
      ->type_name("URL");
  CLI::Option* const attach =
      line.add_option("--attach", arguments.server.session.attach,
                      "show and command the session of trocar-run --live FILE; start none")
          ->type_name("FILE");
  line.add_option(
          "--device", arguments.devices,
          "a device that can be chosen on the page for a session. Repeat the option for several;\n"
          "the first is the default. Without this option, inproc is the only choice. Devices:\n"
          "inproc: simulated in trocar-run\n"
          "sim: simulated by trocar-device-sim, a separate process\n"
          "URI: any other device of trocar-run --device. Its options may follow, each after a "
          "comma:\n"
          "key-file=FILE, device-description=FILE, force-limit=N, force-scale=F, simulated")
      ->type_name("DEVICE")
      ->allow_extra_args(false);
  CLI::Option* const start =
      line.add_option(
              "--start", arguments.start,
              "a scene in FOLDER; its session starts when the operator's page is first opened")
          ->type_name("SCENE");
  line.add_option(
          "--page", arguments.page,
          "for developers: folder of the page's files (default: the one that was installed)")
      ->type_name("FOLDER");
  CLI::Option* const igtl =
      line.add_option(
              "--igtl", arguments.igtl,
              "let 3D Slicer and others watch the session by OpenIGTLink at [ADDRESS:]PORT, "
              "such as 18944\n"
              "(default address: 127.0.0.1)")
          ->type_name("[ADDRESS:]PORT");
  CLI::Option* const recording =
      line.add_option("--recording", arguments.recording,
                      "play this recording, and start no sessions; needs --scene")
          ->type_name("FILE");
  add_number(line, "--stiffness-limit", arguments.server.session.stiffness_limit_N_per_m,
             {10.0, 1e8, "N/M", "N/m"}, "in every session: trocar-run --stiffness-limit");
  CLI::Option* const against =
      line.add_option("--against", arguments.against,
                      "with --recording: a second recording, to show beside the first")
          ->type_name("FILE");
  CLI::Option* const scene = line.add_option("--scene", arguments.scene,
                                             "with --recording: the scene in which it was recorded")
                                 ->type_name("FILE");
  recording->needs(scene);
  scene->needs(recording);
  against->needs(recording);
  start->excludes(attach);
  for (CLI::Option* option : {folder, attach, start, igtl})
    option->excludes(recording);
  line.footer(
      "Prints two links. With the first link, the operator commands the device. With the second\n"
      "link, an audience watches; the audience can press only the emergency stop. Ctrl-C ends\n"
      "the console and the session that it has started. If the console is killed, its session\n"
      "goes on; a new console for the same folder finds it, and does not end it.\n"
      "Exit codes: 0 done; 2 wrong usage; 3 input refused; 4 the address is not available; 1 an "
      "internal error.");
}

Result<void> check_device(const DeviceChoice& device) {
  const std::string shown = "--device " + device.name;
  const bool has_key = device.has("--key-file");
  if (device.name == kSimulator) {
    if (!device.words.empty()) return usage(shown + ": takes no options");
    return {};
  }
  const Result<void> known = check_device_uri(device.name, has_key);
  if (!known && check_device_uri(device.name, !has_key))
    return usage(shown + (has_key ? ": takes no key-file" : ": needs ,key-file=FILE"));
  if (!known) return usage(known.error().message + " or sim");
  if (device.has("--simulated") && !is_device_process(device.name))
    return usage(shown + (may_have_motors(device.name) ? ": has motors; leave ,simulated out"
                                                       : ": is always simulated"));
  return {};
}

// Returns the devices of the command line; inproc if it names none.
Result<std::vector<DeviceChoice>> devices_of(const Arguments& arguments) {
  std::vector<DeviceChoice> devices;
  for (const std::string& text : arguments.devices) {
    Result<DeviceChoice> device = parse_device_choice(text);
    if (!device) return device.error();
    if (const auto good = check_device(*device); !good) return good.error();
    for (const DeviceChoice& each : devices)
      if (each.name == device->name) return usage("--device " + each.name + ": is given twice");
    devices.push_back(std::move(*device));
  }
  if (devices.empty()) devices.emplace_back();
  return devices;
}

// Returns the folder of the sessions; empty: sessions/ in FOLDER itself. Folders that are installed
// beside the program are never changed, whoever runs it.
std::filesystem::path sessions_elsewhere(const std::string& folder,
                                         const std::filesystem::path& programs) {
  std::error_code error;
  const std::filesystem::path installed =
      std::filesystem::weakly_canonical(programs / "../share/trocar", error);
  const std::string there = std::filesystem::canonical(folder, error).string();
  if (error || (::access(there.c_str(), W_OK) == 0 && !there.starts_with(installed.string() + "/")))
    return {};
  const char* const state = std::getenv("XDG_STATE_HOME");  // NOLINT(concurrency-mt-unsafe)
  const char* const home = std::getenv("HOME");             // NOLINT(concurrency-mt-unsafe)
  if (state != nullptr && *state == '/') return std::filesystem::path(state) / "trocar/sessions";
  if (home == nullptr || *home != '/') return {};
  return std::filesystem::path(home) / ".local/state/trocar/sessions";
}

int run_command_line(int argc, char** argv) {
  Arguments arguments;
  arguments.server.port = 4841;
  CLI::App line(
      "Serves the operator's console: a web page that starts, shows and commands sessions of\n"
      "trocar-run, and plays their recordings.",
      kName);
  add_help(line, "trocar-console " TROCAR_VERSION " (" + library_versions() +
                     ", Boost.Beast, OpenIGTLink, Draco and tinygltf for assets)");
  declare(line, arguments);
  if (const auto done = parse_or_end(line, {argv, argv + argc})) return *done;
  if (arguments.folder.empty() && arguments.recording.empty())
    return fail(usage("FOLDER is missing; or name a recording by --recording"));
  ServerSettings& settings = arguments.server;
  if (!arguments.public_url.empty()) {
    if (const auto ok = public_url_of(arguments.public_url).into(settings.public_url); !ok)
      return fail(ok.error());
  }
  if (!arguments.igtl.empty()) {
    if (const auto ok = parse_igtl_address(arguments.igtl).into(settings.igtl); !ok)
      return fail(ok.error());
  }
  std::error_code error;
  settings.session.programs = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  if (const auto ok = devices_of(arguments).into(settings.session.devices); !ok)
    return fail(ok.error());
  const bool plays = !arguments.recording.empty();
  Result<Files> files =
      plays ? Files::of_recording(arguments.recording, arguments.against, arguments.scene)
            : Files::of_folder(arguments.folder,
                               sessions_elsewhere(arguments.folder, settings.session.programs));
  if (!files) return fail(files.error());
  settings.session.folder = files->folder();
  settings.session.sessions = files->sessions();
  if (!arguments.start.empty()) {
    if (const auto scene = files->find(arguments.start); !scene) return fail(scene.error());
    settings.start = json_text(arguments.start);
  }
  if (plays) {
    const std::filesystem::path recording = arguments.recording, against = arguments.against;
    for (const std::string& file : {arguments.recording, arguments.against, arguments.scene}) {
      if (!file.empty() && !std::filesystem::is_regular_file(file, error))
        return fail(refused(file + ": there is no such file"));
    }
    const std::string name = recording.filename().string(), other = against.filename().string(),
                      scene = std::filesystem::path(arguments.scene).filename().string();
    nlohmann::json playback = {{"recording", name}, {"scene", scene}};
    if (!other.empty())
      playback["against"] = other == name || other == scene ? "against-" + other : other;
    settings.playback = json_text(playback);
  }
  Result<PageFiles> page = PageFiles::read(
      arguments.page.empty() ? page_folder() : std::filesystem::path(arguments.page));
  if (!page) return fail(page.error());
  if (const auto ok = serve(settings, std::move(*files), std::move(*page)); !ok)
    return fail(ok.error());
  return 0;
}

}  // namespace
}  // namespace trocar::runtime

int main(int argc, char** argv) {
  using namespace trocar::runtime;
  return trocar::run_program(kName, [&] { return run_command_line(argc, argv); });
}
