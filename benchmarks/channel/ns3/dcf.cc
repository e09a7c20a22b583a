// IEEE 802.11 DCF by ns-3's own models, for `python -m benchmarks ns3`: one setting, several seeds, CSV on stdout.
//
// A program of its own: lostlink neither imports, links nor ships it. This file is under lostlink's licence (Apache 2.0),
// ns-3 under the GPL, version 2 only. The two do not go together in one work that is passed on: build the program where
// it is run, and pass no binary on. It needs ns-3.37 with its headers, as in Debian's libns3-dev; to build it:
//
//   g++ -std=c++17 -O2 dcf.cc -o dcf -lns3-wifi -lns3-propagation -lns3-mobility -lns3-network -lns3-core
//
// Stations are ad hoc, without QoS, at one rate, with one queue that never fills, and send raw frames: no ARP, no IP.
// Each row has the packets of one sender in one part of the time, by the instant at which they entered the radio.

#include "ns3/core-module.h"
#include "ns3/llc-snap-header.h"
#include "ns3/mobility-module.h"
#include "ns3/network-module.h"
#include "ns3/propagation-module.h"
#include "ns3/wifi-module.h"

#include <cstring>
#include <iostream>
#include <map>
#include <sstream>
#include <utility>
#include <vector>

using namespace ns3;

namespace
{

struct Options
{
    std::string standard = "a";
    std::string mode = "OfdmRate6Mbps";
    std::string controlMode = "OfdmRate6Mbps";
    std::string at = "0;1";        // x or x,y of each node, m
    std::string senders = "0";     // nodes
    int to = -1;                   // the node that packets are for; -1: all
    int observer = 1;              // whose receptions of broadcasts count
    int mover = -1;                // moves along x
    double speed = 0.0;            // m/s
    uint32_t bytes = 200;          // of a packet, without LLC and MAC headers
    double rate = 0.0;             // packets per second and sender, a Poisson process; 0: saturated
    double seconds = 1.0;
    uint32_t parts = 1;            // of the time
    uint32_t seeds = 1;
    double rssDbm = 0.0;           // received by all; 0: by distance
    double exponent = 3.0;
    double lossDb = 46.6777;       // at 1 m
    double txDbm = 16.0;
    double noiseFigureDb = 7.0;
    double preambleDbm = -82.0;
    double energyDbm = -62.0;
    double captureDb = 0.0;        // 0: none
    double captureWindowUs = 16.0;
    uint32_t rtsFrom = 65535;      // bytes of a frame
    uint32_t attempts = 7;
    bool wholeHeaders = false;     // the PLCP header of a frame always comes through
};

// NIST's model for payloads, and headers without errors if asked: ns-3 ends a reception whose header fails as though
// nothing had been received, so that no EIFS follows.
class ErrorModel : public ErrorRateModel
{
  public:
    explicit ErrorModel(bool wholeHeaders)
        : m_wholeHeaders(wholeHeaders)
    {
    }

  private:
    double DoGetChunkSuccessRate(WifiMode mode, const WifiTxVector& vector, double snr, uint64_t bits,
                                 uint8_t antennas, WifiPpduField field, uint16_t station) const override
    {
        bool isHeader = field == WIFI_PPDU_FIELD_NON_HT_HEADER;
        return m_wholeHeaders && isHeader
                   ? 1.0
                   : m_nist->GetChunkSuccessRate(mode, vector, snr, bits, antennas, field, station);
    }

    bool m_wholeHeaders;
    Ptr<NistErrorRateModel> m_nist = CreateObject<NistErrorRateModel>();
};

struct Stamp
{
    uint32_t node;
    uint32_t number;
    int64_t atNs;
};

struct Count
{
    uint64_t offered = 0;
    uint64_t transmitted = 0;
    uint64_t delivered = 0;
    double delayS = 0.0;
};

std::vector<std::string>
Split(const std::string& text, char by)
{
    std::vector<std::string> parts;
    std::istringstream stream(text);
    for (std::string part; std::getline(stream, part, by);)
    {
        parts.push_back(part);
    }
    return parts;
}

class Network
{
  public:
    explicit Network(const Options& options)
        : m_options(options)
    {
        Place();
        Install();
        for (const auto& sender : Split(m_options.senders, ','))
        {
            Begin(std::stoul(sender));
        }
    }

    void Run()
    {
        bool saturated = m_options.rate == 0.0;
        Simulator::Stop(Seconds(m_options.seconds + (saturated ? 0.0 : 2.0)));
        Simulator::Run();
        Simulator::Destroy();
    }

    void Print(uint32_t seed) const
    {
        for (const auto& [key, count] : m_counts)
        {
            std::cout << seed << ',' << key.first << ',' << key.second << ',' << count.offered << ','
                      << count.transmitted << ',' << count.delivered << ',' << count.delayS << '\n';
        }
    }

  private:
    void Place()
    {
        auto at = Split(m_options.at, ';');
        m_nodes.Create(at.size());
        for (uint32_t i = 0; i < at.size(); ++i)
        {
            auto xy = Split(at[i], ',');
            auto mobility = CreateObject<ConstantVelocityMobilityModel>();
            m_nodes.Get(i)->AggregateObject(mobility);
            mobility->SetPosition(Vector(std::stod(xy[0]), xy.size() > 1 ? std::stod(xy[1]) : 0.0, 0.0));
            mobility->SetVelocity(Vector(int(i) == m_options.mover ? m_options.speed : 0.0, 0.0, 0.0));
        }
    }

    Ptr<YansWifiChannel> Channel() const
    {
        YansWifiChannelHelper channel;
        channel.SetPropagationDelay("ns3::ConstantSpeedPropagationDelayModel");
        if (m_options.rssDbm != 0.0)
        {
            channel.AddPropagationLoss("ns3::FixedRssLossModel", "Rss", DoubleValue(m_options.rssDbm));
        }
        else
        {
            channel.AddPropagationLoss("ns3::LogDistancePropagationLossModel",
                                       "Exponent", DoubleValue(m_options.exponent),
                                       "ReferenceLoss", DoubleValue(m_options.lossDb));
        }
        return channel.Create();
    }

    void Install()
    {
        bool isB = m_options.standard == "b";
        YansWifiPhyHelper phy;
        phy.SetChannel(Channel());
        phy.Set("ChannelSettings", StringValue(isB ? "{1, 22, BAND_2_4GHZ, 0}" : "{36, 20, BAND_5GHZ, 0}"));
        phy.Set("TxPowerStart", DoubleValue(m_options.txDbm));
        phy.Set("TxPowerEnd", DoubleValue(m_options.txDbm));
        phy.Set("RxNoiseFigure", DoubleValue(m_options.noiseFigureDb));
        phy.Set("RxSensitivity", DoubleValue(-114.0));
        phy.Set("CcaEdThreshold", DoubleValue(m_options.energyDbm));
        phy.SetPreambleDetectionModel("ns3::ThresholdPreambleDetectionModel",
                                      "Threshold", DoubleValue(-100.0),
                                      "MinimumRssi", DoubleValue(m_options.preambleDbm));
        if (m_options.captureDb > 0.0)
        {
            phy.SetFrameCaptureModel("ns3::SimpleFrameCaptureModel",
                                     "Margin", DoubleValue(m_options.captureDb),
                                     "CaptureWindow", TimeValue(MicroSeconds(m_options.captureWindowUs)));
        }
        WifiHelper wifi;
        wifi.SetStandard(isB ? WIFI_STANDARD_80211b : WIFI_STANDARD_80211a);
        wifi.SetRemoteStationManager("ns3::ConstantRateWifiManager",
                                     "DataMode", StringValue(m_options.mode),
                                     "ControlMode", StringValue(m_options.controlMode),
                                     "NonUnicastMode", StringValue(m_options.mode),
                                     "RtsCtsThreshold", UintegerValue(m_options.rtsFrom),
                                     "MaxSsrc", UintegerValue(m_options.attempts),
                                     "MaxSlrc", UintegerValue(m_options.attempts));
        WifiMacHelper mac;
        mac.SetType("ns3::AdhocWifiMac", "QosSupported", BooleanValue(false));
        m_devices = wifi.Install(phy, mac, m_nodes);
        for (uint32_t i = 0; i < m_devices.GetN(); ++i)
        {
            auto device = DynamicCast<WifiNetDevice>(m_devices.Get(i));
            device->GetPhy()->SetErrorRateModel(CreateObject<ErrorModel>(m_options.wholeHeaders));
            device->SetReceiveCallback([this, i](auto, auto packet, auto, auto) { return Received(i, packet); });
            device->GetPhy()->TraceConnectWithoutContext(
                "PhyTxBegin", MakeCallback(&Network::Transmitted, this));
        }
    }

    void Begin(uint32_t node)
    {
        if (m_options.rate > 0.0)
        {
            m_gap[node] = CreateObject<ExponentialRandomVariable>();
            m_gap[node]->SetAttribute("Mean", DoubleValue(1.0 / m_options.rate));
            Simulator::Schedule(Seconds(m_gap[node]->GetValue()), &Network::SendAndGoOn, this, node);
            return;
        }
        auto mac = DynamicCast<WifiNetDevice>(m_devices.Get(node))->GetMac();
        mac->GetTxop()->GetWifiMacQueue()->TraceConnectWithoutContext(
            "Dequeue", Callback<void, Ptr<const WifiMpdu>>([this, node](Ptr<const WifiMpdu>) {
                Simulator::ScheduleNow(&Network::Send, this, node);
            }));
        for (int i = 0; i < 3; ++i)
        {
            Simulator::Schedule(Seconds(0), &Network::Send, this, node);
        }
    }

    void SendAndGoOn(uint32_t node)
    {
        if (Simulator::Now() < Seconds(m_options.seconds))
        {
            Send(node);
            Simulator::Schedule(Seconds(m_gap[node]->GetValue()), &Network::SendAndGoOn, this, node);
        }
    }

    void Send(uint32_t node)
    {
        Stamp stamp{node, m_number++, Simulator::Now().GetNanoSeconds()};
        std::vector<uint8_t> bytes(m_options.bytes, 0);
        std::memcpy(bytes.data(), &stamp, sizeof stamp);
        CountOf(stamp).offered++;
        auto to = m_options.to < 0 ? Mac48Address::GetBroadcast() : m_devices.Get(m_options.to)->GetAddress();
        m_devices.Get(node)->Send(Create<Packet>(bytes.data(), bytes.size()), to, 0x88b5);
    }

    void Transmitted(Ptr<const Packet> frame, double)
    {
        auto packet = frame->Copy();
        WifiMacHeader header;
        packet->RemoveHeader(header);
        if (header.IsData())
        {
            LlcSnapHeader llc;
            packet->RemoveHeader(llc);
            CountOf(StampOf(packet)).transmitted++;
        }
    }

    bool Received(uint32_t node, Ptr<const Packet> packet)
    {
        if (int(node) == (m_options.to < 0 ? m_options.observer : m_options.to))
        {
            auto stamp = StampOf(packet);
            auto& count = CountOf(stamp);
            count.delivered++;
            count.delayS += (Simulator::Now() - NanoSeconds(stamp.atNs)).GetSeconds();
        }
        return true;
    }

    static Stamp StampOf(Ptr<const Packet> packet)
    {
        Stamp stamp;
        uint8_t bytes[sizeof stamp];
        packet->CopyData(bytes, sizeof stamp);
        std::memcpy(&stamp, bytes, sizeof stamp);
        return stamp;
    }

    Count& CountOf(const Stamp& stamp)
    {
        uint32_t part = uint32_t(1e-9 * stamp.atNs / m_options.seconds * m_options.parts);
        return m_counts[{stamp.node, std::min(part, m_options.parts - 1)}];
    }

    Options m_options;
    NodeContainer m_nodes;
    NetDeviceContainer m_devices;
    std::map<uint32_t, Ptr<ExponentialRandomVariable>> m_gap;
    std::map<std::pair<uint32_t, uint32_t>, Count> m_counts;
    uint32_t m_number = 0;
};

} // namespace

int
main(int argc, char* argv[])
{
    Options options;
    CommandLine line;
    line.AddValue("standard", "a or b", options.standard);
    line.AddValue("mode", "of data", options.mode);
    line.AddValue("control-mode", "of RTS", options.controlMode);
    line.AddValue("at", "x or x,y of each node, m, semicolons between", options.at);
    line.AddValue("senders", "nodes, commas between", options.senders);
    line.AddValue("to", "the node that packets are for; -1: all", options.to);
    line.AddValue("observer", "whose receptions of broadcasts count", options.observer);
    line.AddValue("mover", "the node that moves along x; -1: none", options.mover);
    line.AddValue("speed", "its, m/s", options.speed);
    line.AddValue("bytes", "of a packet", options.bytes);
    line.AddValue("rate", "packets per second and sender; 0: saturated", options.rate);
    line.AddValue("seconds", "that are simulated", options.seconds);
    line.AddValue("parts", "of the time, a row each", options.parts);
    line.AddValue("seeds", "how many runs", options.seeds);
    line.AddValue("rss-dbm", "received by all; 0: by distance", options.rssDbm);
    line.AddValue("exponent", "of the law of distance", options.exponent);
    line.AddValue("loss-db", "at 1 m", options.lossDb);
    line.AddValue("tx-dbm", "power of all", options.txDbm);
    line.AddValue("noise-figure-db", "of all", options.noiseFigureDb);
    line.AddValue("preamble-dbm", "the weakest preamble that is detected", options.preambleDbm);
    line.AddValue("energy-dbm", "the weakest power that is a carrier", options.energyDbm);
    line.AddValue("capture-db", "margin of a later frame; 0: no capture", options.captureDb);
    line.AddValue("capture-window-us", "after a preamble, in which there is capture", options.captureWindowUs);
    line.AddValue("rts-from", "bytes of a frame", options.rtsFrom);
    line.AddValue("attempts", "of a unicast", options.attempts);
    line.AddValue("whole-headers", "headers have no errors", options.wholeHeaders);
    line.Parse(argc, argv);
    Config::SetDefault("ns3::WifiMacQueue::MaxSize", StringValue("1000000p"));
    Config::SetDefault("ns3::WifiMacQueue::MaxDelay", TimeValue(Seconds(1000)));
    std::cout << "seed,sender,part,offered,transmitted,delivered,delay_sum_s\n";
    for (uint32_t seed = 1; seed <= options.seeds; ++seed)
    {
        RngSeedManager::SetRun(seed);
        Network network(options);
        network.Run();
        network.Print(seed);
    }
    return 0;
}
