// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_decoder.h"

#include "dsorb/error.h"

#include "io/input/codecs.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <jerror.h>
#include <jpeglib.h>
#include <opencv2/core/mat.hpp>
#include <png.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <csetjmp>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kJpeg = "\xFF\xD8\xFF"sv;
constexpr std::string_view kPng = "\x89PNG\r\n\x1A\n"sv;
constexpr int kHarmlessBytes = 16;  // between two markers: some cameras pad with a few
constexpr int kMostScans = 100;     // of a progressive file; encoders make ten or so

bool begins(const std::vector<std::uint8_t>& bytes, std::string_view text) {
  return bytes.size() >= text.size() && std::memcmp(bytes.data(), text.data(), text.size()) == 0;
}

/// What a library says of a file. It reports errors by a jump out of its functions: whatever it is
/// called from holds plain values only.
struct Complaint {
  std::jmp_buf fatal{};
  std::array<char, JMSG_LENGTH_MAX> text{};  ///< of the first warning that matters, or of the error
};

[[noreturn]] void giveUp(Complaint& complaint, const char* text) {
  std::strncpy(complaint.text.data(), text, complaint.text.size() - 1);
  std::longjmp(complaint.fatal, 1);
}

Complaint& complaintOf(j_common_ptr jpeg) {
  return *static_cast<Complaint*>(jpeg->client_data);
}

[[noreturn]] void onJpegError(j_common_ptr jpeg) {
  std::array<char, JMSG_LENGTH_MAX> text{};
  jpeg->err->format_message(jpeg, text.data());
  giveUp(complaintOf(jpeg), text.data());
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
  Complaint& complaint = complaintOf(jpeg);
  if (level >= 0 || complaint.text[0] != '\0' || !losesPixels(*jpeg->err)) return;
  jpeg->err->format_message(jpeg, complaint.text.data());
}

/// Each scan goes over the whole image: few bytes can ask for hours.
void onProgress(j_common_ptr jpeg) {
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMostScans) return;
  giveUp(complaintOf(jpeg), "more than 100 scans");
}

/// @throws IoError where there are more pixels than are decoded
void checkSize(const cv::Size& size, const std::string& name) {
  if (std::int64_t{size.width} * size.height <= kMaxPixels) return;
  throw fileError(name,
                  "{}; expected {} megapixels at most",
                  pixelText(size.width, size.height),
                  kMaxPixels >> 20U);
}

/// A file in memory that one of the libraries reads, and what the library holds for it.
struct JpegFile {
  explicit JpegFile(const std::vector<std::uint8_t>& file) : bytes(file) {
    progress.progress_monitor = onProgress;
    jpeg.err = jpeg_std_error(&manager);
    jpeg.client_data = &complaint;
    manager.error_exit = onJpegError;
    manager.emit_message = onMessage;
  }
  ~JpegFile() { jpeg_destroy_decompress(&jpeg); }
  JpegFile(const JpegFile&) = delete;
  JpegFile& operator=(const JpegFile&) = delete;

  /// @return whether all rows were there, right or wrong
  bool decode(const std::string& name, cv::Mat& image) {
    if (setjmp(complaint.fatal) != 0) return false;
    jpeg_create_decompress(&jpeg);
    jpeg.client_data = &complaint;
    jpeg.progress = &progress;
    jpeg_mem_src(&jpeg, bytes.data(), bytes.size());
    jpeg_read_header(&jpeg, TRUE);
    const int width = static_cast<int>(jpeg.image_width);
    const int height = static_cast<int>(jpeg.image_height);
    checkSize({width, height}, name);
    const bool is_cmyk = jpeg.num_components == 4;  // only OpenCV makes grey of it
    jpeg.out_color_space = is_cmyk ? JCS_CMYK : JCS_GRAYSCALE;
    image.create(height, width, is_cmyk ? CV_8UC4 : CV_8UC1);
    jpeg_start_decompress(&jpeg);
    while (jpeg.output_scanline < jpeg.output_height) {
      JSAMPROW row = image.ptr(static_cast<int>(jpeg.output_scanline));
      jpeg_read_scanlines(&jpeg, &row, 1);
    }
    jpeg_finish_decompress(&jpeg);
    return complaint.text[0] == '\0';
  }

  const std::vector<std::uint8_t>& bytes;
  Complaint complaint;
  jpeg_error_mgr manager{};
  jpeg_progress_mgr progress{};
  jpeg_decompress_struct jpeg{};
};

constexpr png_fixed_point kRed = 29900;  // of grey, in 1 / 100000
constexpr png_fixed_point kGreen = 58700;

[[noreturn]] void onPngError(png_structp png, png_const_charp message) {
  giveUp(*static_cast<Complaint*>(png_get_error_ptr(png)), message);
}

void onPngWarning(png_structp /*png*/, png_const_charp /*message*/) {}

struct PngFile {
  explicit PngFile(const std::vector<std::uint8_t>& bytes)
      : next(bytes.data()),
        left(bytes.size()),
        png(png_create_read_struct(PNG_LIBPNG_VER_STRING, &complaint, onPngError, onPngWarning)),
        info(png_create_info_struct(png)) {
    png_set_read_fn(png, this, [](png_structp from, png_bytep to, std::size_t size) {
      auto& file = *static_cast<PngFile*>(png_get_io_ptr(from));
      if (size > file.left) png_error(from, "the file ends too early");
      std::copy_n(file.next, size, to);
      file.next += size;
      file.left -= size;
    });
  }
  ~PngFile() { png_destroy_read_struct(&png, &info, nullptr); }
  PngFile(const PngFile&) = delete;
  PngFile& operator=(const PngFile&) = delete;

  /// Colours are weighed as those of Rec. 601, transparency is left out.
  /// @return whether all of the file was there
  bool decode(const std::string& name, cv::Mat& image) {
    if (setjmp(complaint.fatal) != 0) return false;
    png_read_info(png, info);
    const int width = static_cast<int>(png_get_image_width(png, info));
    const int height = static_cast<int>(png_get_image_height(png, info));
    checkSize({width, height}, name);
    const int colour = png_get_color_type(png, info);
    const bool deep = png_get_bit_depth(png, info) == 16;
    if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
    if (png_get_bit_depth(png, info) < 8) png_set_expand_gray_1_2_4_to_8(png);
    if (deep) png_set_swap(png);
    png_set_strip_alpha(png);
    if ((colour & PNG_COLOR_MASK_COLOR) != 0) {
      png_set_rgb_to_gray_fixed(png, PNG_ERROR_ACTION_NONE, kRed, kGreen);
    }
    const int passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    image.create(height, width, deep ? CV_16UC1 : CV_8UC1);
    for (int row = 0; row < passes * height; ++row) {
      png_read_row(png, image.ptr(row % height), nullptr);
    }
    png_read_end(png, nullptr);
    return true;
  }

  Complaint complaint;
  const std::uint8_t* next;
  std::size_t left;
  png_structp png;
  png_infop info;
};

/// Decodes to one grey channel, the same pixels as OpenCV's, but OpenCV fills what is missing of a
/// truncated or damaged JPEG with grey and says so nowhere.
/// @tparam File of PNG or JPEG
/// @return four channels of a JPEG of four colours
/// @throws IoError with the words of the library
template <typename File>
cv::Mat decodeAs(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  File file(bytes);
  cv::Mat image;
  if (file.decode(name, image)) return image;
  throw fileError(name, "the image is truncated or damaged: {}", file.complaint.text.data());
}

constexpr std::array<std::string_view, 10> kImageSuffixes = {
    ".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff", ".webp"};

/// What OpenCV is asked to decode: PNM, BMP, TIFF and WebP. The rest it would hand to GDAL, and to
/// GDCM, which aborts over a damaged DICOM file.
bool isLeftToOpenCv(const std::vector<std::uint8_t>& bytes) {
  const bool pnm = bytes.size() > 2 && bytes[0] == 'P' && bytes[1] >= '1' && bytes[1] <= '6' &&
                   std::isspace(bytes[2]) != 0;
  return pnm || begins(bytes, "BM") || begins(bytes, "II*\0"sv) || begins(bytes, "MM\0*"sv) ||
         begins(bytes, "RIFF");
}

/// Whether a binary PGM or PPM holds the pixels that its header announces: OpenCV says on the
/// terminal where others do not.
bool isCompletePnm(const std::vector<std::uint8_t>& bytes) {
  constexpr std::ptrdiff_t kLongestHeader = 4096;  // with its comments
  const auto size = static_cast<std::ptrdiff_t>(bytes.size());
  std::istringstream header(
      std::string(bytes.begin() + 2, bytes.begin() + std::min(size, kLongestHeader)));
  std::array<std::uint64_t, 3> numbers{};
  for (std::uint64_t& number : numbers) {
    while ((header >> std::ws).peek() == '#') header.ignore(kLongestHeader, '\n');
    header >> number;
  }
  const std::uint64_t values = numbers[0] * numbers[1] * (bytes[1] == '6' ? 3 : 1);
  const auto begin = static_cast<std::uint64_t>(std::max<std::streamoff>(header.tellg(), 0)) + 3;
  return begin + values * (numbers[2] > 255 ? 2 : 1) <= bytes.size();
}

}  // namespace

std::vector<std::uint8_t> readFile(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);  // none of what is no regular file
  if (error) throw fileError(file, "cannot be read: {}", error.message());
  if (size > kMaxImageBytes) throw fileError(file, "{} MiB are too many for an image", size >> 20U);
  std::vector<std::uint8_t> bytes(size);
  std::ifstream stream(file, std::ios::binary);
  stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!stream) throw fileError(file, "cannot be read");
  return bytes;
}

cv::Mat decodeGrey(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  if (bytes.empty() || ((begins(bytes, "P5") || begins(bytes, "P6")) && !isCompletePnm(bytes))) {
    throw fileError(name, "the image is truncated");
  }
  cv::Mat image;
  if (begins(bytes, kPng)) image = decodeAs<PngFile>(bytes, name);
  if (begins(bytes, kJpeg)) image = decodeAs<JpegFile>(bytes, name);
  if (image.channels() == 4 || isLeftToOpenCv(bytes)) image = decodeByOpenCv(bytes);
  if (image.empty()) {
    throw fileError(
        name, "the image cannot be decoded; expected a whole PNG, JPEG, PNM, BMP, TIFF or WebP");
  }
  checkSize(image.size(), name);
  if (image.type() != CV_8UC1 && image.type() != CV_16UC1) {
    throw fileError(name, "neither 8 nor 16 bits a channel");
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
