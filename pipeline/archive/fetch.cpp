// SPDX-License-Identifier: GPL-3.0-or-later
#include "pipeline/archive/fetch.h"

#include <dcmtk/config/osconfig.h>
#include <dcmtk/dcmdata/dctk.h>
#include <dcmtk/dcmnet/assoc.h>
#include <dcmtk/dcmnet/dcmtrans.h>
#include <dcmtk/dcmnet/dimse.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <utility>
#include <vector>

#include "pipeline/archive/storage_classes.h"
#include "pipeline/archive/store_request.h"
#include "pipeline/read/dicom/dicom_parse.h"

namespace trocar::archive {
namespace {

constexpr int kStepS = 1;  // time after which `stop` is looked at

// Frees what ASC_initializeNetwork() and ASC_requestAssociation() make.
struct Connection {
  T_ASC_Network* network = nullptr;
  T_ASC_Association* association = nullptr;

  Connection() = default;
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection() {
    if (association != nullptr) {
      ASC_dropAssociation(association);
      ASC_destroyAssociation(&association);
    }
    if (network != nullptr) ASC_dropNetwork(&network);
  }
};

// The descriptor of a connection, which DCMTK gives to derived classes only.
struct Descriptor : DcmTransportConnection {
  static int of(DcmTransportConnection& connection) {
    return (connection.*&Descriptor::getSocket)();
  }
};

std::atomic<int> late_socket{-1};  // the connection that the alarm ends
std::atomic<bool> is_late{false};  // the alarm has ended it

// Ends the connection if the archive takes too long for an instance, also while DCMTK waits for an
// archive that dribbles: the wait then ends with an error.
class InstanceTime {
 public:
  InstanceTime(T_ASC_Association& association, int seconds) : seconds_(seconds) {
    is_late = false;
    late_socket = Descriptor::of(*DUL_getTransportConnection(association.DULassociation));
    struct sigaction action {};
    action.sa_handler = [](int) {
      is_late = true;
      ::shutdown(late_socket, SHUT_RDWR);
    };
    action.sa_flags = SA_RESTART;
    ::sigaction(SIGALRM, &action, nullptr);
    begin();
  }
  InstanceTime(const InstanceTime&) = delete;
  InstanceTime& operator=(const InstanceTime&) = delete;
  ~InstanceTime() { ::alarm(0); }
  // The time for the next instance begins.
  void begin() const { ::alarm(static_cast<unsigned>(seconds_)); }

 private:
  int seconds_;
};

std::string hexadecimal(unsigned status) {
  char text[8];
  std::snprintf(text, sizeof text, "%04X", status & 0xffff);
  return text;
}

// How messages call the archive.
std::string name_of(const Peer& archive) {
  return archive.ae + "@" + archive.host + ":" + std::to_string(archive.port);
}

class Fetch {
 public:
  Fetch(const FetchSettings& settings, const std::atomic<bool>& stop, StudyFolders& folders,
        std::filesystem::path folder)
      : settings_(settings),
        stop_(stop),
        name_(name_of(settings.archive)),
        folder_(std::move(folder)),
        store_(
            folder_, settings.limits,
            [&folders](const std::string& study) { return folders.size_of(study); },
            [&folders](const std::string& study, const std::string& name, std::uint64_t bytes) {
              return folders.has_instance(study, name, bytes);
            }) {}

  // Receives all instances. The association is released at the end.
  Result<void> run() {
    if (auto ok = connect(); !ok) return ok.error();
    if (auto ok = receive_and_close(); !ok) return ok.error();
    return store_.sync();
  }
  std::size_t left_out() const { return left_out_; }

 private:
  Error failure(const std::string& what) const { return refused(name_ + ": " + what); }
  Error failure(const std::string& what, const OFCondition& why) const {
    if (stop_.load()) return unwritable("interrupted; nothing of the study is kept");
    if (is_late)
      return failure("no instance was complete within " +
                     std::to_string(settings_.limits.dimse_timeout_s) +
                     " s; --dimse-timeout allows more time");
    return failure(what + ": " + printable(why.text()));
  }

  Result<void> connect() {
    const ArchiveLimits& limits = settings_.limits;
    dcmSocketSendTimeout.set(limits.idle_timeout_s);
    dcmSocketReceiveTimeout.set(limits.idle_timeout_s);
    OFCondition done =
        ASC_initializeNetwork(NET_REQUESTOR, 0, limits.acse_timeout_s, &connection_.network);
    if (done.good() && settings_.tls)
      done = ASC_setTransportLayer(connection_.network, settings_.tls.get(), 0);
    T_ASC_Parameters* parameters = nullptr;
    if (done.good()) done = create_parameters(&parameters, limits);
    if (done.good())
      done =
          ASC_setAPTitles(parameters, settings_.ae.c_str(), settings_.archive.ae.c_str(), nullptr);
    if (done.good()) done = ASC_setTransportLayerType(parameters, settings_.tls != nullptr);
    const std::string address =
        settings_.archive.host + ":" + std::to_string(settings_.archive.port);
    std::array<char, 65> own{};
    ::gethostname(own.data(), own.size() - 1);
    if (done.good()) done = ASC_setPresentationAddresses(parameters, own.data(), address.c_str());
    if (done.good()) done = propose(parameters);
    if (done.good())
      done = ASC_requestAssociation(connection_.network, parameters, &connection_.association,
                                    nullptr, nullptr, DUL_NOBLOCK, limits.acse_timeout_s);
    if (done == DUL_ASSOCIATIONREJECTED) return rejection(*parameters);
    if (done.bad()) return failure("no association", done);
    get_context_ = ASC_findAcceptedPresentationContextID(
        connection_.association, UID_GETStudyRootQueryRetrieveInformationModel);
    if (get_context_ == 0) return failure("it does not offer C-GET of studies");
    return {};
  }

  // Newer versions of DCMTK take the longest time for connecting as an argument. Before, it was a
  // global variable.
  static OFCondition create_parameters(T_ASC_Parameters** parameters, const ArchiveLimits& limits) {
#if PACKAGE_VERSION_NUMBER >= 369
    return ASC_createAssociationParameters(parameters, limits.max_pdu_bytes, limits.acse_timeout_s);
#else
    dcmConnectionTimeout.set(limits.acse_timeout_s);
    return ASC_createAssociationParameters(parameters, limits.max_pdu_bytes);
#endif
  }

  Error rejection(T_ASC_Parameters& parameters) const {
    T_ASC_RejectParameters reject{};
    ASC_getRejectParameters(&parameters, &reject);
    if (reject.reason == ASC_REASON_SU_CALLEDAETITLENOTRECOGNIZED)
      return failure("association rejected: its title is not " + settings_.archive.ae);
    if (reject.reason == ASC_REASON_SU_CALLINGAETITLENOTRECOGNIZED)
      return failure("association rejected: it does not know the caller " + settings_.ae);
    return failure("association rejected");
  }

  // The archive may send what it has accepted. It stores each instance in one encoding, so each
  // encoding of CT gets a context of its own. Kinds that are not read are accepted too and dropped,
  // because an archive counts an instance that it cannot send as a failure.
  static OFCondition propose(T_ASC_Parameters* parameters) {
    std::vector<const char*> syntaxes = transfer_syntaxes();
    const char* plain[] = {syntaxes[0], syntaxes[1]};
    unsigned id = 1;
    const auto add = [&](const char* of, const char** list, int count,
                         T_ASC_SC_ROLE role) -> OFCondition {
      if (id > 255) return EC_Normal;  // 128 contexts are the most
      const OFCondition done = ASC_addPresentationContext(
          parameters, static_cast<T_ASC_PresentationContextID>(id), of, list, count, role);
      id += 2;
      return done;
    };
    OFCondition done =
        add(UID_GETStudyRootQueryRetrieveInformationModel, plain, 2, ASC_SC_ROLE_DEFAULT);
    for (const char* of : storage_classes()) {
      const bool is_ct = std::strcmp(of, UID_CTImageStorage) == 0 ||
                         std::strcmp(of, UID_EnhancedCTImageStorage) == 0;
      if (done.good()) done = add(of, plain, 2, ASC_SC_ROLE_SCP);
      for (std::size_t k = 2; k < syntaxes.size() && done.good(); ++k)
        if (is_ct || k == 3 || k == 5) done = add(of, &syntaxes[k], 1, ASC_SC_ROLE_SCP);
    }
    for (int k = 0; k < numberOfDcmShortSCUStorageSOPClassUIDs && done.good(); ++k)
      if (!is_storage_class(dcmShortSCUStorageSOPClassUIDs[k]))
        done = add(dcmShortSCUStorageSOPClassUIDs[k], plain, 2, ASC_SC_ROLE_SCP);
    return done;
  }

  Result<void> request() {
    T_DIMSE_Message message{};
    message.CommandField = DIMSE_C_GET_RQ;
    T_DIMSE_C_GetRQ& get = message.msg.CGetRQ;
    get.MessageID = connection_.association->nextMsgID++;
    std::strncpy(get.AffectedSOPClassUID, UID_GETStudyRootQueryRetrieveInformationModel,
                 sizeof get.AffectedSOPClassUID - 1);
    get.Priority = DIMSE_PRIORITY_MEDIUM;
    get.DataSetType = DIMSE_DATASET_PRESENT;
    DcmDataset wanted;
    wanted.putAndInsertString(DCM_QueryRetrieveLevel, "STUDY");
    wanted.putAndInsertString(DCM_StudyInstanceUID, settings_.study.c_str());
    const OFCondition done = DIMSE_sendMessageUsingMemoryData(
        connection_.association, get_context_, &message, nullptr, &wanted, nullptr, nullptr);
    if (done.bad()) return failure("the request could not be sent", done);
    return {};
  }

  // Waits for the next command, at most for the idle time. Before the first instance it waits as
  // long as an instance may take, because an archive may first get the study from slow storage.
  OFCondition next(T_ASC_PresentationContextID& context, T_DIMSE_Message& message,
                   bool has_begun) const {
    const ArchiveLimits& limits = settings_.limits;
    const int most_s = has_begun ? limits.idle_timeout_s
                                 : std::max(limits.idle_timeout_s, limits.dimse_timeout_s + kStepS);
    OFCondition done = DIMSE_NODATAAVAILABLE;
    for (int waited_s = 0; waited_s < most_s && !stop_.load(); waited_s += kStepS) {
      DcmDataset* detail = nullptr;
      done = DIMSE_receiveCommand(connection_.association, DIMSE_NONBLOCKING, kStepS, &context,
                                  &message, &detail);
      delete detail;
      if (done != DIMSE_NODATAAVAILABLE) return done;
    }
    return done;
  }

  Result<void> receive_and_close() {
    const InstanceTime time(*connection_.association, settings_.limits.dimse_timeout_s);
    if (auto ok = request(); !ok) return ok.error();
    auto received = receive(time);
    time.begin();  // the archive may also delay the end of the association
    if (received)
      ASC_releaseAssociation(connection_.association);
    else
      ASC_abortAssociation(connection_.association);
    return received;
  }

  Result<void> receive(const InstanceTime& time) {
    for (std::size_t instances = 0;;) {
      T_ASC_PresentationContextID context = 0;
      T_DIMSE_Message message{};
      const OFCondition done = next(context, message, instances > 0);
      if (done.bad()) return failure("the archive broke off", done);
      if (message.CommandField == DIMSE_C_STORE_RQ) {
        // An archive that repeats itself, or sends other kinds without end, is not heard for ever.
        if (++instances > settings_.limits.study_instances)
          return failure("it sends more than " + std::to_string(settings_.limits.study_instances) +
                         " instances (--max-instances)");
        if (auto ok = store(context, message.msg.CStoreRQ); !ok) return ok.error();
        time.begin();
      } else if (message.CommandField == DIMSE_C_GET_RSP) {
        const T_DIMSE_C_GetRSP& response = message.msg.CGetRSP;
        if (response.DataSetType != DIMSE_DATASET_NULL) ignore_dataset();
        if (!DICOM_PENDING_STATUS(response.DimseStatus)) return result_of(response);
      } else {
        return failure("the archive sent another command than C-STORE");
      }
    }
  }

  OFCondition ignore_dataset() {
    DIC_UL bytes = 0, fragments = 0;
    return DIMSE_ignoreDataSet(connection_.association, DIMSE_NONBLOCKING,
                               settings_.limits.idle_timeout_s, &bytes, &fragments);
  }

  Result<void> store(T_ASC_PresentationContextID context, const T_DIMSE_C_StoreRQ& request) {
    T_ASC_Association& association = *connection_.association;
    const int timeout_s = settings_.limits.idle_timeout_s;
    const auto is_stopped = [this] { return stop_.load(); };
    if (!is_storage_class(request.AffectedSOPClassUID)) {
      OFCondition done = ignore_dataset();
      if (done.good())
        done = send_store_response(association, context, request, StoreStatus::kStored);
      if (done.bad()) return failure("the archive broke off", done);
      ++left_out_;
      return {};
    }
    const StoreAnswer answer =
        answer_store_request(association, context, request, store_, timeout_s, is_stopped);
    if (answer.network.bad()) return failure("the archive broke off", answer.network);
    const std::string instance = "instance " + printable(request.AffectedSOPInstanceUID) + ": ";
    if (answer.outcome.is_ours)
      return unwritable(settings_.folder.string() + ": " + instance + answer.outcome.why);
    if (answer.outcome.status != StoreStatus::kStored)
      return failure(instance + answer.outcome.why);
    if (answer.outcome.study != settings_.study)
      return failure(instance + "it belongs to another study than the one asked for");
    return {};
  }

  Result<void> result_of(const T_DIMSE_C_GetRSP& response) const {
    const unsigned status = response.DimseStatus;
    const bool has_number = (response.opts & O_GET_NUMBEROFFAILEDSUBOPERATIONS) != 0;
    const bool is_warning = (status & 0xf000) == 0xb000;
    if (has_number && response.NumberOfFailedSubOperations > 0)
      return failure(std::to_string(response.NumberOfFailedSubOperations) +
                     " instances of the study could not be sent");
    if (status != STATUS_Success && !is_warning)
      return failure("C-GET refused (status " + hexadecimal(status) + ")");
    // Instances may be missing, or were sent with warnings: only the number tells which.
    if (is_warning && !has_number)
      return failure("it does not say whether it has sent all instances (status " +
                     hexadecimal(status) + ")");
    return {};
  }

  const FetchSettings& settings_;
  const std::atomic<bool>& stop_;
  std::string name_;
  std::filesystem::path folder_;
  InstanceStore store_;
  Connection connection_;
  T_ASC_PresentationContextID get_context_ = 0;
  std::size_t left_out_ = 0;
};

}  // namespace

Result<FetchedStudy> fetch_study(const FetchSettings& settings, const std::atomic<bool>& stop) {
  pipeline::set_up_dcmtk();
  auto folders = StudyFolders::open(settings.folder);
  if (!folders) return folders.error();
  const auto folder = folders->new_association();
  if (!folder) return folder.error();
  FetchedStudy out;
  const auto received = [&]() -> Result<PublishedStudy> {
    Fetch fetch(settings, stop, *folders, *folder);
    if (auto ok = fetch.run(); !ok) return ok.error();
    out.left_out = fetch.left_out();
    std::error_code ignored;
    if (!std::filesystem::exists(*folder / settings.study, ignored))
      return refused(name_of(settings.archive) + ": it has no images of study " + settings.study +
                     (out.left_out > 0 ? " that trocar-mesh can read" : ""));
    return folders->publish(*folder / settings.study, settings.study);
  }();
  folders->drop_association(*folder);
  if (!received) {
    folders->remove_if_unused();
    return received.error();
  }
  out.study = *received;
  return out;
}

}  // namespace trocar::archive
