// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/receive_command.h"

#include <sys/stat.h>

#include <system_error>

#include "formats/base/program.h"
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
