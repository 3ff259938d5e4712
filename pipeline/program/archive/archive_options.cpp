// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/archive_options.h"

namespace trocar::pipeline {

namespace {

template <typename Number>
void add_limit(const Command& command, const char* name, Number& value, int low, int high,
               const char* help) {
  command.option(name, value, help).with_default_shown().within(low, high).in_group("Limits");
}

// The options of both commands. `instances` and `timeout` are the help texts of --max-instances and
// --dimse-timeout, which differ.
void add_archive_options(const Command& command, ArchiveArguments& a, const char* instances,
                         const char* timeout) {
  const auto file = [&command](const char* name, std::filesystem::path& value, const char* help) {
    command.option(name, value, help).with_form("FILE").in_group("Encryption");
  };
  file("--tls-key", a.tls.key, "private key of this program (PEM)");
  file("--tls-cert", a.tls.cert, "certificate of this program (PEM)");
  file("--tls-ca", a.tls.ca,
       "certificates (PEM), one of which must have signed the other side's certificate");
  command.flag("--insecure", a.insecure, "allow scans to cross the network without encryption")
      .in_group("Encryption");
  add_limit(command, "--max-instance-mb", a.instance_mb, 1, 65'536,
            "largest size of an instance (a DICOM file), MiB");
  add_limit(command, "--max-study-gb", a.study_gb, 1, 65'536, "largest size of a study, GiB");
  add_limit(command, "--max-instances", a.limits.study_instances, 1, 10'000'000, instances);
  add_limit(command, "--max-pdu", a.limits.max_pdu_bytes, 4096, 131'072,
            "largest PDU (a packet of the DICOM protocol), bytes");
  add_limit(command, "--acse-timeout", a.limits.acse_timeout_s, 1, 3600,
            "longest time until an association (a DICOM connection) is established, s");
  add_limit(command, "--dimse-timeout", a.limits.dimse_timeout_s, 1, 86'400, timeout);
  add_limit(command, "--idle-timeout", a.limits.idle_timeout_s, 1, 86'400,
            "end an association if no byte comes from the other side for this time, s; before its "
            "first instance, fetch waits for --dimse-timeout if that is longer");
}

}  // namespace

void add_receive_options(const Command& command, ReceiveArguments& a) {
  command
      .option("FOLDER", a.folder,
              "folder in which each complete study appears as a folder of its own")
      .required();
  command.option("--port", a.port, "TCP port; 0: any free port, which is printed")
      .required()
      .within(0, 65'535);
  command.option("--ae", a.ae, "AE title (DICOM name) of this program, which senders must call")
      .with_form("TITLE")
      .required();
  command.option("--from", a.from, "AE title of a sender that is accepted; may be repeated")
      .with_form("TITLE")
      .required()
      .one_value_each();  // each --from takes one title, and FOLDER may follow
  command
      .option("--listen", a.listen,
              "IP address at which senders connect; 127.0.0.1: only senders on this computer can")
      .with_form("ADDRESS")
      .with_default_shown();
  command
      .option("--settle", a.settle_s,
              "a study is complete if no association (DICOM connection) is sending it, and no "
              "instance\n"
              "(a DICOM file, usually one slice) has come for this many seconds")
      .with_default_shown()
      .within(0.0, 86'400.0);
  command
      .option("--keep", a.keep_hours,
              "remove studies to which no instance was added for this many hours; 0: never")
      .with_default_shown()
      .within(0.0, 1e6);
  command
      .option(
          "--then", a.then,
          "add the scans of each complete study to the file COLLECTION, and make their assets in\n"
          "the folder STORE, as trocar-mesh batch does")
      .two_values()
      .with_form("COLLECTION STORE");
  add_limit(command, "--max-associations", a.max_associations, 1, 1000,
            "largest number of associations at the same time; others wait");
  add_archive_options(command, a.archive, "largest number of instances in a study",
                      "longest time for receiving one instance, s");
}

void add_fetch_options(const Command& command, FetchArguments& a) {
  command
      .option("FOLDER", a.folder, "write the study to FOLDER/UID, where UID is the one of --study")
      .required();
  command.option("--from", a.from, "AE title (DICOM name), host and port of the archive")
      .with_form("TITLE@HOST:PORT")
      .required();
  command.option("--study", a.study, "Study Instance UID of the study to get")
      .with_form("UID")
      .required();
  command.option("--ae", a.ae, "AE title of this program").with_form("TITLE").with_default_shown();
  command.flag("--quiet", a.quiet, "print errors only");
  add_archive_options(
      command, a.archive,
      "largest number of instances in the folder of the study, and largest number that the\n"
      "archive may send (also repeated ones and those that are left out because they are\n"
      "no scans)",
      "longest time from the request, or from the end of one instance, to the end of the next\n"
      "instance, s");
}

archive::ArchiveLimits limits_of(const ArchiveArguments& a) {
  archive::ArchiveLimits out = a.limits;
  out.instance_bytes = static_cast<std::uint64_t>(a.instance_mb) << 20;
  out.study_bytes = static_cast<std::uint64_t>(a.study_gb) << 30;
  return out;
}

}  // namespace trocar::pipeline
