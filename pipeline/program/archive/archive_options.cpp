// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/archive_options.h"

#include "formats/base/option_range.h"

namespace trocar::pipeline {

namespace {

void add_archive_options(CLI::App& app, ArchiveArguments& a) {
  app.add_option("--tls-key", a.tls.key, "private key of this program (PEM)")->group("Encryption");
  app.add_option("--tls-cert", a.tls.cert, "certificate of this program (PEM)")
      ->group("Encryption");
  app.add_option("--tls-ca", a.tls.ca,
                 "certificates (PEM), one of which must have signed the other side's certificate")
      ->group("Encryption");
  app.add_flag("--insecure", a.insecure, "allow scans to cross the network without encryption")
      ->group("Encryption");
  app.add_option("--max-instance-mb", a.instance_mb,
                 "largest size of an instance (a DICOM file), MiB")
      ->capture_default_str()
      ->check(option_range(1, 65'536))
      ->group("Limits");
  app.add_option("--max-study-gb", a.study_gb, "largest size of a study, GiB")
      ->capture_default_str()
      ->check(option_range(1, 65'536))
      ->group("Limits");
  app.add_option("--max-instances", a.limits.study_instances,
                 "largest number of instances in a study")
      ->capture_default_str()
      ->check(option_range(1, 10'000'000))
      ->group("Limits");
  app.add_option("--max-pdu", a.limits.max_pdu_bytes,
                 "largest PDU (a packet of the DICOM protocol), bytes")
      ->capture_default_str()
      ->check(option_range(4096, 131'072))
      ->group("Limits");
  app.add_option("--acse-timeout", a.limits.acse_timeout_s,
                 "longest time until an association (a DICOM connection) is established, s")
      ->capture_default_str()
      ->check(option_range(1, 3600))
      ->group("Limits");
  app.add_option("--dimse-timeout", a.limits.dimse_timeout_s,
                 "longest time for receiving one instance, s")
      ->capture_default_str()
      ->check(option_range(1, 86'400))
      ->group("Limits");
  app.add_option("--idle-timeout", a.limits.idle_timeout_s,
                 "end an association if no byte comes from the other side for this time, s")
      ->capture_default_str()
      ->check(option_range(1, 86'400))
      ->group("Limits");
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
  add_archive_options(app, a.archive);
}

void add_fetch_options(CLI::App& app, FetchArguments& a) {
  app.add_option("FOLDER", a.folder,
                 "write the study to FOLDER/UID, where UID is the one of --study")
      ->required();
  app.add_option("--from", a.from,
                 "AE title (DICOM name), host and port of the archive: AE@HOST:PORT")
      ->required();
  app.add_option("--study", a.study, "Study Instance UID of the study to get")->required();
  app.add_option("--ae", a.ae, "AE title of this program")->capture_default_str();
  app.add_flag("--quiet", a.quiet, "print errors only");
  add_archive_options(app, a.archive);
}

archive::ArchiveLimits limits_of(const ArchiveArguments& a) {
  archive::ArchiveLimits out = a.limits;
  out.instance_bytes = static_cast<std::uint64_t>(a.instance_mb) << 20;
  out.study_bytes = static_cast<std::uint64_t>(a.study_gb) << 30;
  return out;
}

}  // namespace trocar::pipeline
