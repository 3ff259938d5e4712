// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/receive_command.h"

#include <sys/stat.h>

#include <system_error>

#include "formats/base/command_line.h"
#include "formats/base/option_range.h"
#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/messages.h"
#include "pipeline/archive/receiver.h"
#include "pipeline/farm/collection.h"

namespace trocar::pipeline {
namespace {

namespace fs = std::filesystem;

Result<void> check(const ReceiveArguments& a) {
  if (!archive::is_ae_title(a.ae))
    return usage("--ae " + a.ae + ": must have 1 to 16 printable characters");
  for (const std::string& caller : a.from)
    if (!archive::is_ae_title(caller))
      return usage("--from " + caller + ": must have 1 to 16 printable characters");
  if (auto ok = archive::check_transport(a.archive.tls, a.listen, a.archive.insecure); !ok)
    return ok.error();
  std::error_code ignored;
  if (!a.then.empty() && fs::exists(a.then[0], ignored))
    if (const auto read = farm::read_collection(a.then[0]); !read) return read.error();
  return {};
}

}  // namespace

void add_receive_options(CLI::App& app, ReceiveArguments& a) {
  app.add_option("FOLDER", a.folder,
                 "folder in which each complete study appears as a folder of its own")
      ->required();
  app.add_option("--port", a.port, "TCP port; 0: any free port, which is printed")
      ->required()
      ->check(option_range(0, 65'535));
  app.add_option("--ae", a.ae, "AE title (DICOM name) of this program, which senders must call")
      ->required();
  app.add_option("--from", a.from, "AE title of a sender that is accepted; may be repeated")
      ->required()
      ->allow_extra_args(false);  // each --from takes one title, and FOLDER may follow
  app.add_option(
         "--listen", a.listen,
         "IP address at which senders connect; 127.0.0.1: only senders on this computer can")
      ->capture_default_str();
  app.add_option(
         "--settle", a.settle_s,
         "a study is complete if no association (DICOM connection) is sending it, and no instance\n"
         "(a DICOM file, usually one slice) has come for this many seconds")
      ->capture_default_str()
      ->check(option_range(0.0, 86'400.0));
  app.add_option("--keep", a.keep_hours,
                 "remove studies to which no image was added for this many hours; 0: never")
      ->capture_default_str()
      ->check(option_range(0.0, 1e6));
  app.add_option(
         "--then", a.then,
         "add the scans of each complete study to the file COLLECTION, and make their assets in\n"
         "the folder STORE, as trocar-mesh batch does")
      ->type_size(2)
      ->expected(1)
      ->type_name("COLLECTION STORE");
  app.add_option("--max-associations", a.max_associations,
                 "largest number of associations at the same time; others wait")
      ->capture_default_str()
      ->check(option_range(1, 1000))
      ->group("Limits");
  app.add_option("--dimse-timeout", a.archive.limits.dimse_timeout_s,
                 "longest time for receiving one instance, s")
      ->capture_default_str()
      ->check(option_range(1, 86'400))
      ->group("Limits");
  add_archive_options(app, a.archive);
}

int run_receive(const ReceiveArguments& a) {
  if (const auto ok = check(a); !ok) return report_error(archive::kProgram, ok.error());
  const auto tls = archive::make_transport(a.archive.tls, archive::TlsRole::kServer);
  if (!tls) return report_error(archive::kProgram, tls.error());
  archive::ReceiverSettings settings;
  settings.folder = a.folder;
  settings.address = a.listen;
  settings.port = a.port;
  settings.association = {a.ae, a.from, limits_of(a.archive), *tls};
  settings.max_associations = a.max_associations;
  settings.settle_s = a.settle_s;
  settings.keep_hours = a.keep_hours;
  const mode_t mask = ::umask(077);  // received files are readable by this user alone
  if (!a.then.empty())
    settings.then =
        archive::FollowUpSettings{fs::absolute(a.then[0]), fs::absolute(a.then[1]), {}, {}, mask};
  stop_on_signals();
  const auto done = archive::run_receiver(settings, stop_requested);
  return done ? 0 : report_error(archive::kProgram, done.error());
}

}  // namespace trocar::pipeline
