// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/association.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmnet/assoc.h>
#include <dcmtk/dcmnet/dcmtrans.h>
#include <dcmtk/dcmnet/dimse.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <functional>

#include "pipeline/archive/archive_names.h"
#include "pipeline/archive/instance_file.h"
#include "pipeline/archive/messages.h"
#include "pipeline/archive/storage_classes.h"
#include "pipeline/archive/store_request.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::archive {
namespace {

constexpr int kNoLimit = 0;

// Ends the process after this time, also if DCMTK waits for a sender that dribbles. The receiver
// reports SIGALRM as a time-out. kNoLimit lets the process run until the next call.
void allow_seconds(int seconds) {
  ::alarm(static_cast<unsigned>(seconds));
}

std::string trimmed(const char* title) {
  std::string out = title;
  out.erase(0, out.find_first_not_of(' '));
  out.erase(out.find_last_not_of(' ') + 1);
  return out;
}

// The reason for which the request is rejected; no reason is 0.
int reason_to_reject(T_ASC_Association& association, const AssociationSettings& settings) {
  std::array<char, 65> calling{}, called{};
  std::array<char, 129> context{};
  if (ASC_getAPTitles(association.params, calling.data(), calling.size(), called.data(),
                      called.size(), nullptr, 0)
          .bad() ||
      ASC_getApplicationContextName(association.params, context.data(), context.size()).bad() ||
      std::strcmp(context.data(), UID_StandardApplicationContext) != 0)
    return ASC_REASON_SU_APPCONTEXTNAMENOTSUPPORTED;
  const std::string caller = trimmed(calling.data());
  if (trimmed(called.data()) != settings.ae) {
    report("association of " + printable(caller) + " rejected: it calls " +
           printable(trimmed(called.data())));
    return ASC_REASON_SU_CALLEDAETITLENOTRECOGNIZED;
  }
  if (std::find(settings.callers.begin(), settings.callers.end(), caller) ==
      settings.callers.end()) {
    report("association of " + printable(caller) + " rejected: --from does not name it");
    return ASC_REASON_SU_CALLINGAETITLENOTRECOGNIZED;
  }
  return 0;
}

void reject(T_ASC_Association& association, int reason) {
  const T_ASC_RejectParameters parameters = {ASC_RESULT_REJECTEDPERMANENT, ASC_SOURCE_SERVICEUSER,
                                             static_cast<T_ASC_RejectParametersReason>(reason)};
  ASC_rejectAssociation(&association, &parameters);
}

OFCondition accept_contexts(T_ASC_Association& association) {
  std::vector<const char*> classes = storage_classes(), syntaxes = transfer_syntaxes();
  const char* verification[] = {UID_VerificationSOPClass};
  OFCondition done = ASC_acceptContextsWithPreferredTransferSyntaxes(
      association.params, verification, 1, syntaxes.data(), 3);
  if (done.good())
    done = ASC_acceptContextsWithPreferredTransferSyntaxes(
        association.params, classes.data(), static_cast<int>(classes.size()), syntaxes.data(),
        static_cast<int>(syntaxes.size()));
  return done;
}

// Answers requests until the association ends. `release` keeps the instances from then on.
AssociationEnd serve_requests(T_ASC_Association& association, InstanceStore& store,
                              const ArchiveLimits& limits,
                              const std::function<Result<void>()>& release) {
  for (;;) {
    T_ASC_PresentationContextID context = 0;
    T_DIMSE_Message message{};
    allow_seconds(limits.idle_timeout_s + 1);
    OFCondition done = DIMSE_receiveCommand(&association, DIMSE_NONBLOCKING, limits.idle_timeout_s,
                                            &context, &message, nullptr);
    allow_seconds(limits.dimse_timeout_s);
    if (done == DUL_PEERREQUESTEDRELEASE) {
      // The release is acknowledged only after all is on the disk and is kept, whatever happens to
      // this process. A slow disk may take long for a large study, and the sender cannot delay it:
      // there is no limit for it.
      allow_seconds(kNoLimit);
      auto kept = store.sync();
      if (kept) kept = release();
      allow_seconds(limits.dimse_timeout_s);
      if (!kept) {
        report(kept.error().message);
        ASC_abortAssociation(&association);
        return AssociationEnd::kDropped;
      }
      ASC_acknowledgeRelease(&association);
      return AssociationEnd::kReleased;
    }
    if (done.good() && message.CommandField == DIMSE_C_ECHO_RQ) {
      done = DIMSE_sendEchoResponse(&association, context, &message.msg.CEchoRQ, STATUS_Success,
                                    nullptr);
    } else if (done.good() && message.CommandField == DIMSE_C_STORE_RQ) {
      const StoreAnswer answer = answer_store_request(association, context, message.msg.CStoreRQ,
                                                      store, limits.idle_timeout_s);
      done = answer.network;
      if (done.good() && answer.outcome.status != StoreStatus::kStored)
        report("instance " + printable(message.msg.CStoreRQ.AffectedSOPInstanceUID) +
               " refused: " + answer.outcome.why);
    } else if (done.good()) {
      done = DIMSE_BADCOMMANDTYPE;
    }
    if (done.good()) continue;
    if (done != DUL_PEERABORTEDASSOCIATION) ASC_abortAssociation(&association);
    return AssociationEnd::kDropped;
  }
}

}  // namespace

AssociationEnd serve_association(int connection, const std::filesystem::path& folder,
                                 const StudyFolders& studies, const AssociationSettings& settings) {
  pipeline::set_up_dcmtk();
  allow_seconds(settings.limits.acse_timeout_s);
  dcmExternalSocketHandle.set(connection);
  dcmDisableGethostbyaddr.set(OFTrue);  // a name server must not delay an association
  dcmSocketSendTimeout.set(settings.limits.idle_timeout_s);
  dcmSocketReceiveTimeout.set(settings.limits.idle_timeout_s);
  T_ASC_Network* network = nullptr;
  T_ASC_Association* association = nullptr;
  if (ASC_initializeNetwork(NET_ACCEPTOR, 0, settings.limits.acse_timeout_s, &network).bad())
    return AssociationEnd::kDropped;
  if (settings.tls && ASC_setTransportLayer(network, settings.tls.get(), 0).bad())
    return AssociationEnd::kDropped;
  const OFCondition received =
      ASC_receiveAssociation(network, &association, settings.limits.max_pdu_bytes, nullptr, nullptr,
                             settings.tls != nullptr, DUL_NOBLOCK, settings.limits.acse_timeout_s);
  // Connection and memory are freed by the end of the process.
  if (received.bad() || association == nullptr) return AssociationEnd::kRejected;
  if (const int reason = reason_to_reject(*association, settings); reason != 0) {
    reject(*association, reason);
    return AssociationEnd::kRejected;
  }
  if (accept_contexts(*association).bad() || ASC_acknowledgeAssociation(association).bad())
    return AssociationEnd::kDropped;
  InstanceStore store(
      folder, settings.limits, [&](const std::string& study) { return studies.size_of(study); },
      [&](const std::string& study, const std::string& name, std::uint64_t bytes) {
        return studies.has_instance(study, name, bytes);
      });
  const AssociationEnd end =
      serve_requests(*association, store, settings.limits, [&] { return studies.release(folder); });
  ASC_dropSCPAssociation(association, 1);
  return end;
}

}  // namespace trocar::archive
