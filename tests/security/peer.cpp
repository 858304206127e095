// A ROS 2 peer on Fast DDS with DDS Security, as rmw_fastrtps makes one, for tests/security/check.py. Messages are bytes: what is
// in them is the test's affair.
//
//   peer DOMAIN FOLDER|- SECONDS talk TOPIC TYPE HEX      publishes five times a second
//   peer DOMAIN FOLDER|- SECONDS listen TOPIC TYPE        prints each message
//   peer DOMAIN FOLDER|- SECONDS call SERVICE TYPE HEX    calls once, prints the answer
//   peer DOMAIN FOLDER|- SECONDS serve SERVICE TYPE HEX   answers each request
//
// FOLDER is the enclave's, "-" is without security. TYPE is as in std_srvs/srv/Trigger. Ends after SECONDS, or when `call` is answered.
// Prints one line an event: "participant", "matched", "sample HEX", "request HEX", "reply HEX", "unmatched".

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SampleIdentity;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::rtps::WriteParams;

using Bytes = std::vector<unsigned char>;
using Clock = std::chrono::steady_clock;

constexpr uint32_t MOST_BYTES = 4096;

// A type whose serialised form, encapsulation header included, is the value.
class Raw : public TopicDataType {
public:
  explicit Raw(const std::string &name) {
    setName(name.c_str());
    m_typeSize = MOST_BYTES;
    m_isGetKeyDefined = false;
  }
  bool serialize(void *data, SerializedPayload_t *payload) override {
    const Bytes &bytes = *static_cast<Bytes *>(data);
    if (bytes.size() > payload->max_size) return false;
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = static_cast<uint32_t>(bytes.size());
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(SerializedPayload_t *payload, void *data) override {
    static_cast<Bytes *>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void *data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes *>(data)->size()); };
  }
  void *createData() override { return new Bytes; }
  void deleteData(void *data) override { delete static_cast<Bytes *>(data); }
  bool getKey(void *, InstanceHandle_t *, bool) override { return false; }
};

[[noreturn]] void fail(const std::string &what) {
  std::fprintf(stderr, "peer: %s\n", what.c_str());
  std::exit(2);
}

Bytes from_hex(const std::string &text) {
  Bytes bytes;
  for (size_t i = 0; i + 1 < text.size(); i += 2) bytes.push_back(static_cast<unsigned char>(std::stoi(text.substr(i, 2), nullptr, 16)));
  return bytes;
}

void say(const std::string &event, const Bytes &bytes = {}) {
  std::printf("%s", event.c_str());
  for (size_t i = 0; i < bytes.size(); ++i) std::printf("%s%02x", i ? "" : " ", bytes[i]);
  std::printf("\n");
  std::fflush(stdout);
}

// package/kind/Name to package::kind::dds_::Name
std::string dds_type(const std::string &name, const std::string &suffix) {
  const size_t first = name.find('/'), second = name.find('/', first + 1);
  if (first == std::string::npos || second == std::string::npos) fail("a type is package/kind/Name, not " + name);
  return name.substr(0, first) + "::" + name.substr(first + 1, second - first - 1) + "::dds_::" + name.substr(second + 1) + suffix;
}

DomainParticipant *participant(int domain, const std::string &folder) {
  DomainParticipantQos qos = PARTICIPANT_QOS_DEFAULT;
  // The loopback only: nobody else's machine takes part in a test.
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);
  if (folder != "-") {
    auto &properties = qos.properties().properties();
    const std::string auth = "dds.sec.auth.builtin.PKI-DH.", access = "dds.sec.access.builtin.Access-Permissions.", file = "file://" + folder + "/";
    properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
    properties.emplace_back(auth + "identity_ca", file + "identity_ca.cert.pem");
    properties.emplace_back(auth + "identity_certificate", file + "cert.pem");
    properties.emplace_back(auth + "private_key", file + "key.pem");
    properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
    properties.emplace_back(access + "permissions_ca", file + "permissions_ca.cert.pem");
    properties.emplace_back(access + "governance", file + "governance.p7s");
    properties.emplace_back(access + "permissions", file + "permissions.p7s");
    properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  }
  DomainParticipant *made = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
  if (made == nullptr) fail("no participant");
  say("participant");
  return made;
}

Topic *topic(DomainParticipant *participant, const std::string &name, const std::string &type_name) {
  TypeSupport type(new Raw(type_name));
  type.register_type(participant);
  Topic *made = participant->create_topic(name, type_name, TOPIC_QOS_DEFAULT);
  if (made == nullptr) fail("no topic " + name);
  return made;
}

// Null where the peer's own permissions forbid it.
DataWriter *writer(DomainParticipant *participant, Topic *topic) {
  DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, qos);
}

DataReader *reader(DomainParticipant *participant, Topic *topic, ReliabilityQosPolicyKind reliability = RELIABLE_RELIABILITY_QOS) {
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = reliability;
  qos.history().kind = KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 10;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, qos);
}

bool has_match(DataWriter *writer) {
  PublicationMatchedStatus status;
  writer->get_publication_matched_status(status);
  return status.current_count > 0;
}

bool has_match(DataReader *reader) {
  SubscriptionMatchedStatus status;
  reader->get_subscription_matched_status(status);
  return status.current_count > 0;
}

// One message, if there is one.
bool take(DataReader *reader, Bytes &bytes, SampleInfo &info) {
  return reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK && info.valid_data;
}

void rest() { std::this_thread::sleep_for(std::chrono::milliseconds(20)); }

void talk(DataWriter *out, Bytes bytes, Clock::time_point end) {
  if (out == nullptr) return say("forbidden");
  bool matched = false;
  while (Clock::now() < end) {
    if (!matched && has_match(out)) say("matched"), matched = true;
    out->write(&bytes);
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  if (!matched) say("unmatched");
}

void listen(DataReader *in, Clock::time_point end) {
  if (in == nullptr) return say("forbidden");
  bool matched = false;
  while (Clock::now() < end) {
    if (!matched && has_match(in)) say("matched"), matched = true;
    Bytes bytes;
    SampleInfo info;
    while (take(in, bytes, info)) say("sample", bytes);
    rest();
  }
  if (!matched) say("unmatched");
}

void call(DataWriter *out, DataReader *in, Bytes bytes, Clock::time_point end) {
  if (out == nullptr || in == nullptr) return say("forbidden");
  while (!(has_match(out) && has_match(in))) {
    if (Clock::now() >= end) {
      // Says it all the same: whether it is received is the other side's to decide.
      out->write(&bytes);
      std::this_thread::sleep_for(std::chrono::seconds(1));
      return say("unmatched");
    }
    rest();
  }
  say("matched");
  // The server learns of the reader for its answers apart from the one for the requests.
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  WriteParams parameters;
  parameters.related_sample_identity().writer_guid() = in->guid();
  if (!out->write(&bytes, parameters)) fail("the request was not written");
  const auto asked = parameters.sample_identity().sequence_number();
  while (Clock::now() < end) {
    Bytes answer;
    SampleInfo info;
    while (take(in, answer, info))
      if (info.related_sample_identity.sequence_number() == asked) return say("reply", answer);
    rest();
  }
}

void serve(DataReader *in, DataWriter *out, Bytes answer, Clock::time_point end) {
  if (out == nullptr || in == nullptr) return say("forbidden");
  while (Clock::now() < end) {
    Bytes request;
    SampleInfo info;
    while (take(in, request, info)) {
      say("request", request);
      WriteParams parameters;
      SampleIdentity identity = info.sample_identity;
      // As rmw_fastrtps: the request may name the reader that waits for the answer.
      if (info.related_sample_identity.writer_guid() != eprosima::fastrtps::rtps::GUID_t::unknown())
        identity.writer_guid() = info.related_sample_identity.writer_guid();
      parameters.related_sample_identity(identity);
      if (!out->write(&answer, parameters)) fail("the answer was not written");
    }
    rest();
  }
}

int main(int count, char **values) {
  const std::vector<std::string> arguments(values + 1, values + count);
  if (arguments.size() < 6) fail("expected DOMAIN FOLDER|- SECONDS COMMAND NAME TYPE [HEX]");
  const auto end = Clock::now() + std::chrono::milliseconds(static_cast<long>(1000 * std::stod(arguments[2])));
  DomainParticipant *self = participant(std::stoi(arguments[0]), arguments[1]);
  const std::string &command = arguments[3], &name = arguments[4], &type = arguments[5];
  const Bytes bytes = arguments.size() > 6 ? from_hex(arguments[6]) : Bytes();
  const auto request = [&] { return topic(self, "rq" + name + "Request", dds_type(type, "_Request_")); };
  const auto response = [&] { return topic(self, "rr" + name + "Reply", dds_type(type, "_Response_")); };
  if (command == "talk") talk(writer(self, topic(self, "rt" + name, dds_type(type, "_"))), bytes, end);
  else if (command == "listen") listen(reader(self, topic(self, "rt" + name, dds_type(type, "_")), BEST_EFFORT_RELIABILITY_QOS), end);
  else if (command == "call") call(writer(self, request()), reader(self, response()), bytes, end);
  else if (command == "serve") serve(reader(self, request()), writer(self, response()), bytes, end);
  else fail("unknown: " + command);
  self->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(self);
}
