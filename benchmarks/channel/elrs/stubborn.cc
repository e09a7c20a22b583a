// What ExpressLRS carries down with MAVLink: its own StubbornSender and StubbornReceiver, called slot by slot.
//
// A program of its own: lostlink neither imports, links nor ships it. This file is under lostlink's licence (Apache 2.0),
// ExpressLRS under the GPL, version 3. Build the program where it is run, and pass no binary on:
//
//   cd ExpressLRS/src/lib    (commit 7702d0f)
//   g++ -O2 -I StubbornSender -I StubbornReceiver <here>/stubborn.cc Stubborn*/*.cpp -o stubborn
//   ./stubborn
//
// Chunks of 62 bytes always wait at the receiver; nothing is lost. Slots, bursts and sync are as in rx_main.cpp,
// tx_main.cpp and common.cpp: even slots go down, odd ones up. Prints bytes per second of each mode: room in data
// packets, user bytes without sync, and the least and most of them with sync from 20 places in its cycles.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <random>

#include "stubborn_receiver.h"
#include "stubborn_sender.h"

namespace {

struct Mode {
  const char* name;
  int64_t interval_us;
  int data_bytes, hop_slots, channels;
};

const Mode MODES[] = {
    {"flrc-1000", 1000, 5, 2, 80},     {"lora-500", 2000, 5, 4, 80},       {"lora-333-full", 3003, 10, 4, 80},
    {"lora-150", 6666, 5, 4, 80},      {"lora-50", 20000, 5, 2, 80},       {"900-200", 5000, 5, 4, 40},
    {"900-100-full", 10000, 10, 4, 40}, {"900-25", 40000, 5, 2, 40},
};
constexpr int USER = 62, HEAD = 2, STATS = 4, BUFFER = 65, PLACES = 20;
constexpr int64_t SYNC_US = 5'000'000, DURATION_US = 2'000'000'000;

struct Carried {
  double room, user;
};

uint8_t byte_of(uint32_t chunk, int place) { return static_cast<uint8_t>(chunk * 7 + place * 13); }

bool is_whole(const uint8_t* bytes, uint32_t chunk) {
  for (int i = 0; i < USER; i++)
    if (bytes[HEAD + i] != byte_of(chunk, i)) return false;
  return true;
}

// Chunks that arrive are one of the last two that were sent.
bool came(const uint8_t* bytes, uint32_t chunks) {
  return (chunks > 0 && is_whole(bytes, chunks - 1)) || (chunks > 1 && is_whole(bytes, chunks - 2));
}

Carried carried(const Mode& mode, bool has_sync, unsigned seed) {
  std::mt19937 random(seed);
  const int hz = static_cast<int>(1'000'000 / mode.interval_us);
  const int burst = std::max(1, 512 * hz / 2 / 1000 - 1);
  const int hop = static_cast<int>(random() % mode.channels);
  int64_t synced_us = -static_cast<int64_t>(random() % SYNC_US);
  int since_stats = static_cast<int>(random() % (burst + 1)), sync_slot = 0;

  StubbornSender sender;
  StubbornReceiver receiver;
  sender.setMaxPackageIndex(mode.data_bytes == 5 ? 127 : 31);
  receiver.setMaxPackageIndex(mode.data_bytes == 5 ? 127 : 31);
  sender.UpdateTelemetryRate(static_cast<uint16_t>(hz), 2, static_cast<uint8_t>(burst));
  uint8_t sent[HEAD + USER] = {}, received[BUFFER] = {};
  receiver.SetDataToReceive(received, BUFFER);

  uint32_t chunks = 0;
  int64_t arrived = 0, data_packets = 0;
  for (int64_t slot = 0; slot * mode.interval_us < DURATION_US; slot++) {
    if (!sender.IsActive()) {
      for (int i = 0; i < USER; i++) sent[HEAD + i] = byte_of(chunks, i);
      chunks++;
      sender.SetDataToTransmit(sent, sizeof(sent));
    }
    if (receiver.HasFinishedData()) {
      arrived += came(received, chunks);
      receiver.Unlock();
      std::fill(received, received + BUFFER, 0);
    }
    if (slot % 2) {  // up: RC, which confirms, or sync, which does not
      const bool on_sync_channel = (hop + slot / mode.hop_slots) % mode.channels == 0;
      const int64_t now_us = slot * mode.interval_us;
      if (has_sync && on_sync_channel && now_us - synced_us > SYNC_US && sync_slot / 2 <= slot % mode.hop_slots) {
        synced_us = now_us;
        sync_slot = (sync_slot + 1) % (2 * mode.hop_slots);
      } else {
        sender.ConfirmCurrentPayload(receiver.GetCurrentConfirm());
      }
      continue;
    }
    const bool has_stats = since_stats == burst;
    const int room = mode.data_bytes - (has_stats ? STATS : 0);
    since_stats = has_stats ? 0 : since_stats + 1;
    data_packets += !has_stats;
    uint8_t payload[10];
    const uint8_t index = sender.GetCurrentPayload(payload, static_cast<uint8_t>(room));
    receiver.ReceiveData(index, payload, static_cast<uint8_t>(room));
  }
  const double seconds = DURATION_US / 1e6;
  return {data_packets * mode.data_bytes / seconds, arrived * USER / seconds};
}

}  // namespace

int main() {
  std::printf("%-14s %8s %8s %8s %8s\n", "mode", "room", "alone", "least", "most");
  for (const Mode& mode : MODES) {
    const Carried alone = carried(mode, false, 1);
    double least = 1e9, most = 0.0;
    for (unsigned seed = 1; seed <= PLACES; seed++) {
      const double user = carried(mode, true, seed).user;
      least = std::min(least, user);
      most = std::max(most, user);
    }
    std::printf("%-14s %8.1f %8.1f %8.1f %8.1f\n", mode.name, alone.room, alone.user, least, most);
  }
}
