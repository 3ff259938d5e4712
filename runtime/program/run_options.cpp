// SPDX-License-Identifier: Apache-2.0
#include "runtime/program/run_options.h"

#include <string>

#include "formats/session/force_law_kind.h"
#include "formats/session/procedures.h"
#include "formats/session/scene.h"
#include "runtime/devices/open_device.h"

namespace trocar::runtime {
namespace {

/// Declares options under one heading of the help text.
class Group {
 public:
  Group(const Command& command, const char* heading) : command_(command), heading_(heading) {}

  template <typename Value>
  Option option(const char* names, Value& value, const std::string& help) {
    return command_.option(names, value, help).in_group(heading_);
  }
  void flag(const char* names, bool& value, const char* help) {
    command_.flag(names, value, help).in_group(heading_);
  }

 private:
  Command command_;
  const char* heading_;
};

void declare_session_options(const Command& command, RunArguments& a) {
  Group session(command, "Session");
  session
      .option(
          "--clock", a.clock,
          "real: ticks follow the wall clock; virtual: ticks follow each other without a pause,\n"
          "and every run gives the same result (default: real)")
      .one_of({"real", "virtual"});
  session
      .option("--rate", a.rate_Hz,
              "rate of the haptic loop, 100 to 8000 Hz (default: the scene's, or 1000)")
      .within(kMinRate_Hz, kMaxRate_Hz, "HZ", "Hz");
  session.option("--duration", a.duration_s, "duration in s (default: the scene's)")
      .within(1e-3, kMaxDuration_s, "S", "s");
  session
      .option(
          "--replay", a.replay,
          "compute a recorded session again from its recorded inputs, with the virtual clock, and\n"
          "compare the torques. Exit code 3 if they differ, or if scene, asset, device or options\n"
          "are not those of the recording")
      .with_form("RECORDING");
  session
      .option(
          "--live", a.live,
          "let other programs show and command the session, through the file FILE. Give the same\n"
          "name to the other program, for example trocar-console --attach FILE. While the session\n"
          "runs, FILE is a symbolic link to shared memory")
      .with_form("FILE");
  session.flag(
      "--xray", a.xray,
      "with --live: let the other programs ask for simulated X-ray pictures, single ones or a\n"
      "series (fluoroscopy). Recording, summary and report state how much X-ray was used");
  session.flag("--quiet", a.quiet, "print errors only");

  Group recording(command, "Recording");
  recording
      .option("--record", a.record,
              "write a recording: CSV, one row per tick. Its name ends in .partial until it is\n"
              "complete")
      .with_form("FILE");
  recording.option("--summary", a.summary, "write a summary of the session, or of --test, as JSON")
      .with_form("FILE");
  recording
      .option(
          "--session-report", a.session_report,
          "write a report for the debriefing: the page NAME.html, and its figures as NAME.json\n"
          "and NAME.figures.csv. It states the path, the forces, how far the tip plunged after\n"
          "each break-through, breaches of the bone's wall, tremor, and whether the scene's goals\n"
          "were reached")
      .with_form("NAME.html");
  recording
      .option(
          "--trainee", a.trainee.code,
          "code that stands for the trainee in recording, summary and report: 1 to 32 letters,\n"
          "digits, - or _. It need not be a name")
      .with_form("CODE");
  recording
      .option("--course", a.trainee.course, "name of the course: 1 to 32 letters, digits, - or _")
      .with_form("NAME");
  recording.option("--attempt", a.trainee.attempt, "number of the attempt, 1 to 9999");
  recording
      .option(
          "--history", a.history,
          "run no session; read all session reports in this folder and its subfolders. Where a\n"
          "folder has no report, its summary is read instead. Write the learning curves of\n"
          "each trainee, course and scene to the page -o NAME.html, and their numbers to\n"
          "NAME.history.csv")
      .with_form("FOLDER");
  recording
      .option(
          "--hand-path", a.hand_path,
          "write the motion of a live hand (see --live-hand) as JSON, for use as the `hand` of a\n"
          "scene")
      .with_form("FILE");
}

void declare_safety_options(const Command& command, RunArguments& a) {
  Group safety(command, "Safety");
  safety
      .option(
          "--recover", a.recover,
          "what to do after a fault (a failed check, such as of speed or connection, which takes\n"
          "the forces away) or a stop. never: end the session; signal: let the forces rise again\n"
          "when the signal SIGUSR1 comes, but no stop is pressed; auto, only without motors: the\n"
          "same, but after a failed check let them rise by themselves (default: never)")
      .one_of({"never", "auto", "signal"});
  safety
      .option("--energy-limit", a.energy_limit_J,
              "largest energy in J that the device may give to the hand within 0.1 s, in\n"
              "addition to the energy that tissue and coupling (the spring between device and\n"
              "virtual tool) held at the beginning of this time. If the device gives more, the\n"
              "fault energy_limit is raised (default: 0.05)")
      .within(1e-3, 10.0, "J", "J");
  safety
      .option(
          "--stiffness-limit", a.stiffness_limit_N_per_m,
          "largest stiffness of contact at the tool's tip, 10 to 100000000 N/m. With a\n"
          "device that measures its own pose, the option limits every force law. With the\n"
          "four-legged device it limits only the force law cutting. There are also other\n"
          "limits (--simulated names them). The lowest limit counts. Without this option, only\n"
          "the other limits apply")
      .within(10.0, 1e8, "N/M", "N/m");
  safety
      .option("--force-limit", a.force_limit_N,
              "for a device that measures its own pose: largest force that is sent to it, 0.01 to\n"
              "1000 N (default: what its description states)")
      .within(0.01, 1000.0, "N", "N");
  safety
      .option(
          "--force-scale", a.force_scale,
          "factor on the forces of the tissue, 0.001 to 10, instead of the scene's factor.\n"
          "Without this option, the scene's factor is used, with one exception. Each slice and\n"
          "soft layer of the scene has a largest force, at which it breaks. If a device that\n"
          "measures its own pose is too weak for one of these forces, the factor is lowered\n"
          "until the device can produce them all. With the force law cutting, it must produce\n"
          "1.5 times the forces of the slices, because friction on the shaft adds to them")
      .within(1e-3, 10.0, "FACTOR");
  safety.option(
      "--late-ticks-in-row", a.late_ticks_in_row,
      "raise a fault after this many consecutive late ticks (missed deadlines); 0: only count\n"
      "late ticks (default: 3 for a device with motors; 0 for a simulated device, where late\n"
      "ticks do no harm)");
  safety
      .option(
          "--black-box", a.black_box,
          "folder for black boxes. After a fault, a black box is written: the recording of\n"
          "the last 4 s before the torques were zero (default: the folder of --record, or else\n"
          "the current folder, or else the folder for temporary files)")
      .with_form("FOLDER");

  Group diagnostics(command, kDiagnostics);
  diagnostics
      .option("--meshes", a.meshes,
              "write the sheets (the slices' meshes) before and after the punctures, as JSON")
      .with_form("FILE");
  diagnostics
      .option("--frames", a.frames,
              "write the sheet around the tool 30 times a second, as lines of JSON")
      .with_form("FILE");
  diagnostics
      .option("--passivity", a.passivity,
              "on: add damping. With hooke and network, it removes energy that the loop generates\n"
              "(passivity controller). With cutting, it slows the tool after a break-through.\n"
              "off: add no damping (default: on)")
      .one_of({"on", "off"});
  diagnostics
      .option(
          "--coupling", a.coupling_N_per_m,
          "put a spring of this stiffness, 100 to 1000000 N/m, between the device and a virtual\n"
          "tool (proxy). Only the virtual tool then touches the tissue. Default with hooke and\n"
          "network: no spring, but for a device that measures its own pose, a stiffness is\n"
          "chosen. Default with cutting: the scene and the device determine the spring")
      .within(100.0, 1e6, "N/M", "N/m");
  diagnostics.option("--cpu", a.cpu,
                     "number of the processor on which the haptic loop stays (default: any)");
}

void declare_scene_options(const Command& command, RunArguments& a) {
  Group scene(command, "Scene");
  scene.option("--asset", a.asset, "use this asset (.glb, from trocar-mesh) instead of the scene's")
      .with_form("FILE");
  scene
      .option("--force-law", a.force_law,
              force_law_names() +
                  ": rule by which the tissue's\n"
                  "force is computed, instead of the scene's. hooke: one spring for each slice; "
                  "network: a\n"
                  "spring network for each slice; cutting: bone as one solid that the tool cuts")
      .with_form("LAW");
  scene
      .option("--procedure", a.procedure,
              procedure_names() +
                  ":\n"
                  "use the tool, the soft layers over the bone and the bone's resistance of this "
                  "procedure\n"
                  "instead of the scene's")
      .with_form("PROCEDURE");
  scene
      .option("--strength", a.strength,
              "with --procedure: how strongly the tissue resists: low, median or high (default: "
              "median).\n"
              "--explain prints the range of each quantity of tool, layers and bone: its 5th "
              "percentile\n"
              "(low), its median and its 95th percentile (high)")
      .one_of({"low", "median", "high"});
  scene.flag("--explain", a.explain,
             "run no session; print the values of --procedure, or of all procedures, with\n"
             "their ranges and sources");
  scene.flag(
      "--check", a.check,
      "run no session; print the motor torques that the scene needs and the region that the\n"
      "tip can reach. Then do a dry run with the simulated device, and warn of faults (failed\n"
      "checks, which stop the forces) and of slices that the tool never touches");
  scene.flag("--strict", a.strict, "with --check: end with exit code 3 if there is a warning");
  scene
      .option(
          "--new-scene", a.new_scene,
          "run no session; propose a scene for this asset (.glb) and write it to the file of -o")
      .with_form("ASSET");
  scene
      .option(
          "--entry", a.entry,
          "with --new-scene: a point X,Y,Z on the needle's path, at the bone's surface or outside\n"
          "the bone (default: where the bone is thickest). X, Y and Z are DICOM's patient\n"
          "coordinates in mm (LPS: x to the patient's left, y to the back, z to the head)")
      .with_form("X,Y,Z");
  scene
      .option("--target", a.target,
              "with --entry: the point X,Y,Z that the needle must reach, in the same coordinates\n"
              "(default: the needle goes straight down, at right angles to the slices)")
      .with_form("X,Y,Z");
  scene.flag("--live-hand", a.live_hand,
             "with --new-scene: make a scene whose simulated hand you move in trocar-console");
  scene
      .option("-o,--output", a.output,
              "with --new-scene: the scene to write, JSON; with --history: the page to write, HTML")
      .with_form("FILE");
}

void declare_device_options(const Command& command, RunArguments& a) {
  Group device(command, "Device");
  device
      .option("--device", a.device,
              device_uri_help() +
                  "\nudp is for the four-legged device. inproc simulates that device, or the "
                  "one of\n--device-description (default: " +
                  std::string(kDefaultDevice) + ")")
      .with_form("DEVICE");
  device.flag(
      "--simulated", a.simulated,
      "with udp and pose: say that the device has no motors, because it is only simulated. Then\n"
      "late ticks (missed deadlines) are no fault, and data may be missing for 250 ms instead of\n"
      "10 ms. One exception: with --late-ticks-in-row above 0, late ticks are still a fault, and\n"
      "data may be missing for only 10 ms.\n"
      "Without --simulated, every device but inproc is assumed to have motors. If the\n"
      "description of such a device states more mass than the device has, or more stiffness than\n"
      "it can render stably, contact with the device can vibrate. As a margin, Trocar therefore\n"
      "halves the following limits on the stiffness of contact:\n"
      "- with the force law cutting: the limit that Trocar computes from the device's mass\n"
      "- with a pose device (a device that measures its own pose): the largest stiffness that its\n"
      "  description states\n"
      "- with hooke or network, and a pose device whose description states no largest stiffness:\n"
      "  Trocar's own limit of 10000 N/m, which then becomes 5000 N/m.\n"
      "The limit of --stiffness-limit is never halved");
  device.flag(
      "--test", a.test_device,
      "run no session; read the device for --duration (default: 5 s), command no force, and say\n"
      "whether a session at --rate would run without faults (exit code 5 if not)");
  device
      .option(
          "--key-file", a.key_file,
          "file with the secret key by which this program and the device process recognise each\n"
          "other; both need the same key")
      .with_form("FILE");
  device
      .option("--device-description", a.description,
              "JSON file with the device's geometry and limits, instead of the one that the scene "
              "names")
      .with_form("FILE");
  device
      .option("--compensate", a.compensate,
              "which of the device's own forces the motors cancel: none, friction, weight or both\n"
              "(default: none)")
      .one_of({"none", "friction", "weight", "both"});
}

}  // namespace

void declare_run_options(CommandLine& line, RunArguments& a) {
  line.option(
      "SCENE", a.scene,
      "the scene: a JSON file that names the asset (meshes of a scan), the tissues, the tool and\n"
      "the motion of the simulated hand, which holds the simulated device.\n"
      "formats/session/scene.schema.json describes each field. SCENE is not needed\n"
      "with --new-scene, --explain, --history and --test");
  declare_scene_options(line, a);
  declare_device_options(line, a);
  declare_session_options(line, a);
  declare_safety_options(line, a);
  line.set_footer(
      "Exit codes: 0 done; 2 wrong usage; 3 input refused, or torques of --replay differ, or\n"
      "a warning with --check --strict; 4 output not written; 5 device failed, or a fault ended\n"
      "the session, or --test found trouble, or a check was interrupted before its result;\n"
      "1 an internal error. Ctrl-C ends a session with zero torques and complete files.");
}

}  // namespace trocar::runtime
