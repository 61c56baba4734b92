// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/jpeg_decoder.h"

#include "dsorb/error.h"

#include "io/input/image_decoder.h"

#include <fmt/format.h>
#include <jerror.h>
#include <jpeglib.h>

#include <array>
#include <csetjmp>
#include <cstdio>

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

}  // namespace

bool isJpeg(const std::vector<std::uint8_t>& bytes) {
  return bytes.size() >= 3 && bytes[0] == 0xFF && bytes[1] == 0xD8 && bytes[2] == 0xFF;
}

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

}  // namespace dsorb
