// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/program/archive/archive_options.h"

#include "formats/base/option_range.h"

namespace trocar::pipeline {

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
  app.add_option("--idle-timeout", a.limits.idle_timeout_s,
                 "end an association if no byte comes from the other side for this time, s")
      ->capture_default_str()
      ->check(option_range(1, 86'400))
      ->group("Limits");
}

archive::ArchiveLimits limits_of(const ArchiveArguments& a) {
  archive::ArchiveLimits out = a.limits;
  out.instance_bytes = static_cast<std::uint64_t>(a.instance_mb) << 20;
  out.study_bytes = static_cast<std::uint64_t>(a.study_gb) << 30;
  return out;
}

}  // namespace trocar::pipeline
