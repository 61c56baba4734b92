// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>

namespace dsorb {

/// The lowest bytes of a number, highest first.
inline std::string bigEndian(std::uint64_t number, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) {
    text += static_cast<char>(i < 8 ? number >> (8 * i) & 0xFFU : 0);
  }
  return text;
}

/// A box of an MP4 file (ISO/IEC 14496-12).
inline std::string box(const std::string& name, const std::string& content) {
  return bigEndian(content.size() + 8, 4) + name + content;
}

/// A quarter of a second of silence, 16 bits at 8 kHz, as the only track of an MP4 file.
inline std::string soundAsMp4() {
  constexpr std::uint64_t kRate = 8000, kSamples = 2000;
  const std::string unity = bigEndian(0x10000, 4) + std::string(12, '\0') + bigEndian(0x10000, 4) +
                            std::string(12, '\0') + bigEndian(0x40000000, 4);
  const std::string header =
      box("mvhd",
          bigEndian(0, 12) + bigEndian(kRate, 4) + bigEndian(kSamples, 4) + bigEndian(0x10000, 4) +
              bigEndian(0x0100, 2) + bigEndian(0, 10) + unity + bigEndian(0, 24) + bigEndian(2, 4));
  const std::string track =
      box("tkhd",
          bigEndian(7, 4) + bigEndian(0, 8) + bigEndian(1, 4) + bigEndian(0, 4) +
              bigEndian(kSamples, 4) + bigEndian(0, 12) + bigEndian(0x0100, 2) + bigEndian(0, 2) +
              unity + bigEndian(0, 8));
  const std::string format =
      box("sowt",
          bigEndian(0, 6) + bigEndian(1, 2) + bigEndian(0, 8) + bigEndian(1, 2) + bigEndian(16, 2) +
              bigEndian(0, 4) + bigEndian(kRate << 16U, 4));
  const std::string start = box("ftyp", "isom" + bigEndian(0, 4) + "isom");
  const std::string samples = box("mdat", std::string(2 * kSamples, '\0'));
  const std::string table =
      box("stbl",
          box("stsd", bigEndian(0, 4) + bigEndian(1, 4) + format) +
              box("stts",
                  bigEndian(0, 4) + bigEndian(1, 4) + bigEndian(kSamples, 4) + bigEndian(1, 4)) +
              box("stsc",
                  bigEndian(0, 4) + bigEndian(1, 4) + bigEndian(1, 4) + bigEndian(kSamples, 4) +
                      bigEndian(1, 4)) +
              box("stsz", bigEndian(0, 4) + bigEndian(2, 4) + bigEndian(kSamples, 4)) +
              box("stco", bigEndian(0, 4) + bigEndian(1, 4) + bigEndian(start.size() + 8, 4)));
  const std::string data =
      box("dinf", box("dref", bigEndian(0, 4) + bigEndian(1, 4) + box("url ", bigEndian(1, 4))));
  const std::string media =
      box("mdia",
          box("mdhd",
              bigEndian(0, 12) + bigEndian(kRate, 4) + bigEndian(kSamples, 4) + bigEndian(0, 4)) +
              box("hdlr", bigEndian(0, 8) + "soun" + bigEndian(0, 13)) +
              box("minf", box("smhd", bigEndian(0, 8)) + data + table));
  return start + samples + box("moov", header + box("trak", track + media));
}

/// An element of a Matroska file (RFC 9559).
inline std::string element(std::uint64_t id, int id_bytes, const std::string& content) {
  return bigEndian(id, id_bytes) + bigEndian(0x10000000U | content.size(), 4) + content;
}

/// The same sound as the only track of a Matroska file.
inline std::string soundAsMkv() {
  const std::string head = element(0x1A45DFA3, 4, element(0x4282, 2, "matroska"));
  const std::string sound = element(0xB5, 1, bigEndian(0x45FA0000, 4)) +  // 8000 as a float
                            element(0x6264, 2, bigEndian(16, 1));
  const std::string track = element(0xD7, 1, bigEndian(1, 1)) +
                            element(0x73C5, 2, bigEndian(1, 1)) +
                            element(0x83, 1, bigEndian(2, 1)) +  // sound
                            element(0x86, 1, "A_PCM/INT/LIT") + element(0xE1, 1, sound);
  const std::string samples = bigEndian(0x81000080, 4) + std::string(4000, '\0');
  const std::string cluster = element(0xE7, 1, bigEndian(0, 1)) + element(0xA3, 1, samples);
  return head +
         element(0x18538067,
                 4,
                 element(0x1654AE6B, 4, element(0xAE, 1, track)) + element(0x1F43B675, 4, cluster));
}

}  // namespace dsorb
