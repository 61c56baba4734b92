// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_decoder.h"

#include "dsorb/error.h"

#include "io/input/codecs.h"
#include "io/input/image_header.h"
#include "io/png.h"

#include <fmt/format.h>
#include <jerror.h>
#include <jpeglib.h>
#include <opencv2/core/mat.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {
namespace {

constexpr int kHarmlessBytes = 16;  // between two markers: some cameras pad with a few
constexpr int kMostScans = 100;     // of a progressive file; encoders make ten or so

/// What libjpeg says of a file. It reports errors by a jump out of its functions: whatever it is
/// called from holds plain values only.
struct Complaints {
  jpeg_error_mgr manager{};
  std::jmp_buf fatal{};
  std::array<char, JMSG_LENGTH_MAX> text{};  ///< of the first that matters; empty: none
};

Complaints& complaintsOf(j_common_ptr jpeg) {
  return *static_cast<Complaints*>(jpeg->client_data);
}

void keepText(j_common_ptr jpeg) {
  Complaints& complaints = complaintsOf(jpeg);
  if (complaints.text[0] == '\0') jpeg->err->format_message(jpeg, complaints.text.data());
}

[[noreturn]] void onJpegError(j_common_ptr jpeg) {
  keepText(jpeg);
  std::longjmp(complaintsOf(jpeg).fatal, 1);
}

/// Whether pixels are missing or wrong after a warning.
bool losesPixels(const jpeg_error_mgr& manager) {
  switch (manager.msg_code) {
    case JWRN_HIT_MARKER:
    case JWRN_HUFF_BAD_CODE:
    case JWRN_JPEG_EOF:
    case JWRN_MUST_RESYNC:
    case JWRN_NOT_SEQUENTIAL:
      return true;
    case JWRN_EXTRANEOUS_DATA:
      return manager.msg_parm.i[0] > kHarmlessBytes;
    default:
      return false;
  }
}

void onMessage(j_common_ptr jpeg, int level) {
  if (level < 0 && losesPixels(*jpeg->err)) keepText(jpeg);
}

/// Each scan goes over the whole image: few bytes can ask for hours.
void onProgress(j_common_ptr jpeg) {
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMostScans) return;
  Complaints& complaints = complaintsOf(jpeg);
  std::snprintf(complaints.text.data(), complaints.text.size(), "more than %d scans", kMostScans);
  std::longjmp(complaints.fatal, 1);
}

/// Frees what libjpeg holds.
struct Decompressor {
  Decompressor() {
    progress.progress_monitor = onProgress;
    jpeg.err = jpeg_std_error(&complaints.manager);
    jpeg.client_data = &complaints;
    complaints.manager.error_exit = onJpegError;
    complaints.manager.emit_message = onMessage;
  }
  ~Decompressor() { jpeg_destroy_decompress(&jpeg); }
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;

  Complaints complaints;
  jpeg_progress_mgr progress{};
  jpeg_decompress_struct jpeg{};
};

/// @return whether the header could be read
bool readJpegHeader(Decompressor& d, const std::uint8_t* bytes, std::size_t size) {
  if (setjmp(d.complaints.fatal) != 0) return false;
  jpeg_create_decompress(&d.jpeg);
  d.jpeg.client_data = &d.complaints;
  d.jpeg.progress = &d.progress;
  jpeg_mem_src(&d.jpeg, bytes, size);
  jpeg_read_header(&d.jpeg, TRUE);
  d.jpeg.out_color_space = d.jpeg.num_components == 4 ? JCS_CMYK : JCS_GRAYSCALE;
  return true;
}

/// @param row_bytes from one row of `pixels` to the next; 0: all into the same
/// @return whether all rows were there, right or wrong
bool readJpegRows(Decompressor& d, std::uint8_t* pixels, std::size_t row_bytes) {
  if (setjmp(d.complaints.fatal) != 0) return false;
  jpeg_start_decompress(&d.jpeg);
  while (d.jpeg.output_scanline < d.jpeg.output_height) {
    JSAMPROW row = pixels + row_bytes * d.jpeg.output_scanline;
    jpeg_read_scanlines(&d.jpeg, &row, 1);
  }
  jpeg_finish_decompress(&d.jpeg);
  return true;
}

/// Whether the bytes begin as those of a JPEG.
bool isJpeg(const std::vector<std::uint8_t>& bytes) {
  return bytes.size() >= 3 && bytes[0] == 0xFF && bytes[1] == 0xD8 && bytes[2] == 0xFF;
}

/// Decodes a JPEG to one grey channel of 8 bits. The same pixels as OpenCV's, but OpenCV fills what
/// is missing of a truncated or damaged file with grey and says so nowhere.
/// @param name of the file, for messages
/// @return empty where the file is intact but has four channels, which only OpenCV converts
/// @throws IoError with the words of libjpeg
cv::Mat decodeJpeg(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  Decompressor d;
  cv::Mat image;
  bool done = readJpegHeader(d, bytes.data(), bytes.size());
  const bool grey = done && d.jpeg.num_components != 4;
  if (done) {
    const auto width = static_cast<int>(d.jpeg.image_width);
    const auto height = static_cast<int>(d.jpeg.image_height);
    if (std::int64_t{width} * height > kMaxPixels) {
      throw IoError(fmt::format("{}: {}x{} px are too many", name, width, height));
    }
    image.create(grey ? height : 1, width, grey ? CV_8UC1 : CV_8UC4);
    done = readJpegRows(d, image.data, grey ? image.step[0] : 0);
  }
  const char* complaint = d.complaints.text.data();
  if (!done || *complaint != '\0') {
    throw IoError(fmt::format("{}: the image is truncated or damaged: {}", name, complaint));
  }
  return grey ? image : cv::Mat();
}

constexpr std::array<std::string_view, 10> kImageSuffixes = {
    ".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff", ".webp"};

bool startsWith(const std::vector<std::uint8_t>& bytes, std::string_view magic) {
  return bytes.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin(), [](char m, std::uint8_t b) {
           return static_cast<std::uint8_t>(m) == b;
         });
}

/// Whether OpenCV is asked to decode this: PNM, BMP, TIFF, WebP, and what libjpeg does not convert.
/// The rest it would hand to GDAL, and to GDCM, which aborts over a damaged DICOM file.
bool isLeftToOpenCv(const std::vector<std::uint8_t>& bytes) {
  using namespace std::string_view_literals;
  if (startsWith(bytes, "P")) {
    return bytes.size() > 2 && bytes[1] >= '1' && bytes[1] <= '6' && std::isspace(bytes[2]) != 0;
  }
  return isJpeg(bytes) || startsWith(bytes, "BM") || startsWith(bytes, "II*\0"sv) ||
         startsWith(bytes, "MM\0*"sv) || startsWith(bytes, "RIFF");
}

/// Whether a binary PGM or PPM holds the pixels its header announces: "P5 width height maximum"
/// and one more white space.
bool completePnm(const std::vector<std::uint8_t>& bytes, std::size_t channels) {
  std::array<std::size_t, 3> header{};
  std::size_t at = 2;
  for (std::size_t& number : header) {
    while (at < bytes.size() && std::isdigit(bytes[at]) == 0) {
      const bool comment = bytes[at++] == '#';
      while (comment && at < bytes.size() && bytes[at] != '\n') ++at;
    }
    constexpr std::size_t kTooLarge = 1000000;
    while (at < bytes.size() && std::isdigit(bytes[at]) != 0 && number < kTooLarge) {
      number = 10 * number + (bytes[at++] - std::size_t{'0'});
    }
  }
  const std::size_t bytes_per_value = header[2] > 255 ? 2 : 1;
  return at + 1 + header[0] * header[1] * channels * bytes_per_value <= bytes.size();
}

bool complete(const std::vector<std::uint8_t>& bytes) {
  if (startsWith(bytes, "P5")) return completePnm(bytes, 1);
  if (startsWith(bytes, "P6")) return completePnm(bytes, 3);
  return !bytes.empty();
}

}  // namespace

std::vector<std::uint8_t> readFile(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);  // none of what is no regular file
  if (error) throw IoError(fmt::format("{}: cannot be read: {}", file.string(), error.message()));
  if (size > kMaxImageBytes) {
    throw IoError(fmt::format("{}: {} MiB are too many for an image", file.string(), size >> 20U));
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw IoError(fmt::format("{}: cannot be read", file.string()));
  std::vector<std::uint8_t> bytes(size);
  if (size > 0 &&
      !stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size))) {
    throw IoError(fmt::format("{}: cannot be read", file.string()));
  }
  return bytes;
}

cv::Mat decodeGrey(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  if (!complete(bytes)) throw IoError(fmt::format("{}: the image is truncated", name));
  const std::optional<cv::Size> size = sizeInHeader(bytes);
  if (size && std::int64_t{size->width} * size->height > kMaxPixels) {
    throw IoError(fmt::format("{}: {}x{} px; expected {} megapixels at most",
                              name,
                              size->width,
                              size->height,
                              kMaxPixels >> 20U));
  }
  if (isPng(bytes)) return decodePng(bytes, name);
  cv::Mat image;
  if (isJpeg(bytes)) image = decodeJpeg(bytes, name);
  if (image.empty() && size && isLeftToOpenCv(bytes)) image = decodeByOpenCv(bytes);
  if (image.empty()) {
    throw IoError(fmt::format(
        "{}: the image cannot be decoded; expected PNG, JPEG, PNM, BMP, TIFF or WebP", name));
  }
  if (image.type() != CV_8UC1 && image.type() != CV_16UC1) {
    throw IoError(fmt::format("{}: neither 8 nor 16 bits a channel", name));
  }
  return image;
}

std::string lowerSuffix(const std::filesystem::path& file) {
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return suffix;
}

bool hasImageSuffix(const std::filesystem::path& file) {
  return std::find(kImageSuffixes.begin(), kImageSuffixes.end(), lowerSuffix(file)) !=
         kImageSuffixes.end();
}

}  // namespace dsorb
