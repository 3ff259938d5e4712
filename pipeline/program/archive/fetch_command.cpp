// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/fetch_command.h"

#include <sys/stat.h>

#include <cstdio>

#include "formats/base/program.h"
#include "formats/base/terminal_text.h"
#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/fetch.h"
#include "pipeline/archive/messages.h"

namespace trocar::pipeline {
namespace {

Result<archive::FetchSettings> settings_of(const FetchArguments& a) {
  archive::FetchSettings out;
  auto peer = archive::parse_peer(a.from);
  if (!peer) return usage("--from " + peer.error().message);
  if (!archive::is_uid(a.study))
    return usage("--study " + a.study + ": must be a UID, numbers separated by dots");
  if (!archive::is_ae_title(a.ae))
    return usage("--ae " + a.ae + ": must have 1 to 16 printable characters");
  if (auto ok = archive::check_transport(a.archive.tls, peer->host, a.archive.insecure); !ok)
    return ok.error();
  const auto tls = archive::make_transport(a.archive.tls, archive::TlsRole::kClient);
  if (!tls) return tls.error();
  out.archive = *peer;
  out.ae = a.ae;
  out.study = a.study;
  out.folder = a.folder;
  out.limits = limits_of(a.archive);
  out.tls = *tls;
  return out;
}

}  // namespace

int run_fetch(const FetchArguments& a) {
  const auto settings = settings_of(a);
  if (!settings) return report_error(archive::kProgram, settings.error());
  ::umask(077);  // received files are readable by this user alone
  stop_on_signals();
  const auto done = archive::fetch_study(*settings, stop_requested);
  if (!done) return report_error(archive::kProgram, done.error());
  const archive::PublishedStudy& study = done->study;
  if (study.different > 0)
    archive::report("warning: " + std::to_string(study.different) +
                    " instances differ from those that are stored, which were kept");
  if (!a.quiet) {
    print(stdout, "%s: %zu instances, %.1f MB", (settings->folder / a.study), study.instances,
          static_cast<double>(study.bytes) / 1e6);
    if (study.added < study.instances) std::printf("; %zu of them new", study.added);
    if (done->left_out > 0) std::printf("; %zu instances of other kinds left out", done->left_out);
    std::printf("\n");
  }
  return 0;
}

}  // namespace trocar::pipeline
