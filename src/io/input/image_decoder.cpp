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
#include <limits>
#include <optional>
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
  d.jpeg.out_color_space = JCS_GRAYSCALE;
  return true;
}

/// @param row_bytes from one row of `pixels` to the next
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

/// @throws IoError where there are more pixels than are decoded
void checkSize(const cv::Size& size, const std::string& name) {
  if (std::int64_t{size.width} * size.height <= kMaxPixels) return;
  throw IoError(fmt::format("{}: {}; expected {} megapixels at most",
                            name,
                            pixelText(size.width, size.height),
                            kMaxPixels >> 20U));
}

/// Decodes a JPEG to one grey channel of 8 bits. The same pixels as OpenCV's, but OpenCV fills what
/// is missing of a truncated or damaged file with grey and says so nowhere.
/// @param name of the file, for messages
/// @return empty where it has four channels, which only OpenCV converts
/// @throws IoError with the words of libjpeg
cv::Mat decodeJpeg(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  Decompressor d;
  cv::Mat image;
  bool done = readJpegHeader(d, bytes.data(), bytes.size());
  if (done) {
    const cv::Size size(static_cast<int>(d.jpeg.image_width),
                        static_cast<int>(d.jpeg.image_height));
    checkSize(size, name);
    if (d.jpeg.num_components == 4) return {};
    image.create(size, CV_8UC1);
    done = readJpegRows(d, image.data, image.step[0]);
  }
  const char* complaint = d.complaints.text.data();
  if (done && *complaint == '\0') return image;
  throw IoError(fmt::format("{}: the image is truncated or damaged: {}", name, complaint));
}

constexpr png_fixed_point kRed = 29900;  // of grey, in 1 / 100000
constexpr png_fixed_point kGreen = 58700;

/// What libpng says of a file. It reports errors by a jump out of its functions: whatever it is
/// called from holds plain values only.
struct Complaint {
  std::array<char, 128> text{};
};

[[noreturn]] void onPngError(png_structp png, png_const_charp message) {
  auto& text = static_cast<Complaint*>(png_get_error_ptr(png))->text;
  std::strncpy(text.data(), message, text.size() - 1);
  png_longjmp(png, 1);
}

void onWarning(png_structp /*png*/, png_const_charp /*message*/) {}

/// A file in memory that is read.
struct Reader {
  explicit Reader(const std::vector<std::uint8_t>& bytes)
      : next(bytes.data()),
        left(bytes.size()),
        png(png_create_read_struct(PNG_LIBPNG_VER_STRING, &complaint, onPngError, onWarning)),
        info(png_create_info_struct(png)) {
    png_set_read_fn(png, this, [](png_structp from, png_bytep to, std::size_t size) {
      auto& reader = *static_cast<Reader*>(png_get_io_ptr(from));
      if (size > reader.left) png_error(from, "the file ends too early");
      std::copy_n(reader.next, size, to);
      reader.next += size;
      reader.left -= size;
    });
  }
  ~Reader() { png_destroy_read_struct(&png, &info, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  Complaint complaint;
  const std::uint8_t* next;
  std::size_t left;
  png_structp png;
  png_infop info;
};

/// Reads the header and asks for one grey channel. @return whether that went well
bool readPngHeader(Reader& r) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_read_info(r.png, r.info);
  const int colour = png_get_color_type(r.png, r.info);
  if (colour == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(r.png);
  if (png_get_bit_depth(r.png, r.info) < 8) png_set_expand_gray_1_2_4_to_8(r.png);
  if (png_get_bit_depth(r.png, r.info) == 16) png_set_swap(r.png);
  png_set_strip_alpha(r.png);
  if ((colour & PNG_COLOR_MASK_COLOR) != 0) {
    png_set_rgb_to_gray_fixed(r.png, PNG_ERROR_ACTION_NONE, kRed, kGreen);
  }
  png_set_interlace_handling(r.png);
  png_read_update_info(r.png, r.info);
  return true;
}

/// @param rows of the image, to be filled
/// @return whether all of the file was there
bool readPngRows(Reader& r, png_bytepp rows) {
  if (setjmp(png_jmpbuf(r.png)) != 0) return false;
  png_read_image(r.png, rows);
  png_read_end(r.png, nullptr);
  return true;
}

/// Decodes a PNG to one grey channel of 8 or 16 bits, the same pixels as OpenCV's: colours are
/// weighed as those of Rec. 601, transparency is left out.
/// @param name of the file, for messages
/// @throws IoError with the words of libpng where the file is truncated or damaged
cv::Mat decodePng(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  Reader reader(bytes);
  cv::Mat image;
  bool done = readPngHeader(reader);
  if (done) {
    const auto width = static_cast<int>(png_get_image_width(reader.png, reader.info));
    const auto height = static_cast<int>(png_get_image_height(reader.png, reader.info));
    const bool deep = png_get_bit_depth(reader.png, reader.info) == 16;
    image.create(height, width, deep ? CV_16UC1 : CV_8UC1);
    std::vector<png_bytep> rows;
    rows.reserve(static_cast<std::size_t>(height));
    for (int y = 0; y < height; ++y) rows.push_back(image.ptr(y));
    done = readPngRows(reader, rows.data());
  }
  if (!done) {
    throw IoError(fmt::format(
        "{}: the image is truncated or damaged: {}", name, reader.complaint.text.data()));
  }
  return image;
}

constexpr std::array<std::string_view, 10> kImageSuffixes = {
    ".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff", ".webp"};

/// Bytes with positions that need not exist: there they are 0.
struct Bytes {
  const std::vector<std::uint8_t>& data;

  [[nodiscard]] std::uint32_t at(std::size_t i) const { return i < data.size() ? data[i] : 0; }
  [[nodiscard]] std::uint32_t big(std::size_t i, int count) const {
    std::uint32_t value = 0;
    for (int k = 0; k < count; ++k) value = value << 8U | at(i + static_cast<std::size_t>(k));
    return value;
  }
  [[nodiscard]] std::uint32_t little(std::size_t i, int count) const {
    std::uint32_t value = 0;
    for (int k = count; k-- > 0;) value = value << 8U | at(i + static_cast<std::size_t>(k));
    return value;
  }
  [[nodiscard]] std::uint32_t number(std::size_t i, int count, bool is_big) const {
    return is_big ? big(i, count) : little(i, count);
  }
  [[nodiscard]] bool has(std::string_view text, std::size_t i = 0) const {
    if (data.size() < i + text.size()) return false;
    for (std::size_t k = 0; k < text.size(); ++k) {
      if (data[i + k] != static_cast<std::uint8_t>(text[k])) return false;
    }
    return true;
  }
};

std::optional<cv::Size> sizeOf(std::uint32_t width, std::uint32_t height) {
  constexpr std::uint32_t kMost = std::numeric_limits<int>::max();
  if (width == 0 || height == 0 || width > kMost || height > kMost) return std::nullopt;
  return cv::Size(static_cast<int>(width), static_cast<int>(height));
}

bool isPnm(const Bytes& b) {
  return b.at(0) == 'P' && b.at(1) >= '1' && b.at(1) <= '6' &&
         std::isspace(static_cast<int>(b.at(2))) != 0;
}

/// Header of a PNM: "P5 width height maximum", comments between.
struct PnmHeader {
  std::array<std::uint32_t, 3> numbers{};
  std::size_t end = 2;  ///< behind the last of them
};

PnmHeader pnmHeader(const Bytes& b) {
  PnmHeader header;
  std::size_t& i = header.end;
  for (std::uint32_t& number : header.numbers) {
    while (i < b.data.size() && std::isdigit(b.data[i]) == 0) {
      const bool comment = b.data[i++] == '#';
      while (comment && i < b.data.size() && b.data[i] != '\n') ++i;
    }
    constexpr std::uint32_t kTooLarge = 100000000;
    while (std::isdigit(static_cast<int>(b.at(i))) != 0 && number < kTooLarge) {
      number = 10 * number + (b.at(i++) - '0');
    }
  }
  return header;
}

/// Whether a binary PGM or PPM holds the pixels its header announces, behind one more white space.
bool isCompletePnm(const Bytes& b) {
  const auto [numbers, end] = pnmHeader(b);
  const std::uint64_t values = std::uint64_t{numbers[0]} * numbers[1] * (b.has("P6") ? 3U : 1U);
  return end + 1 + values * (numbers[2] > 255 ? 2U : 1U) <= b.data.size();
}

/// The entries 256 and 257 of the first directory.
std::optional<cv::Size> tiffSize(const Bytes& b) {
  const bool big = b.at(0) == 'M';
  const std::size_t directory = b.number(4, 4, big);
  const std::uint32_t entries = b.number(directory, 2, big);
  std::array<std::uint32_t, 2> numbers{};
  for (std::uint32_t k = 0; k < entries; ++k) {
    const std::size_t entry = directory + 2 + std::size_t{12} * k;
    if (entry >= b.data.size()) break;
    const std::uint32_t tag = b.number(entry, 2, big);
    const int bytes = b.number(entry + 2, 2, big) == 3 ? 2 : 4;  // SHORT or LONG
    if (tag == 256 || tag == 257) numbers.at(tag - 256) = b.number(entry + 8, bytes, big);
  }
  return sizeOf(numbers[0], numbers[1]);
}

std::optional<cv::Size> webpSize(const Bytes& b) {
  if (b.has("VP8X", 12)) return sizeOf(1 + b.little(24, 3), 1 + b.little(27, 3));
  if (b.has("VP8 ", 12)) return sizeOf(b.little(26, 2) & 0x3FFFU, b.little(28, 2) & 0x3FFFU);
  if (!b.has("VP8L", 12)) return std::nullopt;
  const std::uint32_t bits = b.little(21, 4);
  return sizeOf(1 + (bits & 0x3FFFU), 1 + (bits >> 14U & 0x3FFFU));
}

/// Whether OpenCV is asked to decode this: PNM, BMP, TIFF, WebP, and what libjpeg does not convert.
/// The rest it would hand to GDAL, and to GDCM, which aborts over a damaged DICOM file.
bool isLeftToOpenCv(const Bytes& b) {
  return isPnm(b) || b.has(kJpeg) || b.has("BM") || b.has("II*\0"sv) || b.has("MM\0*"sv) ||
         b.has("RIFF");
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

std::optional<cv::Size> sizeInHeader(const std::vector<std::uint8_t>& bytes) {
  const Bytes b{bytes};
  if (b.has(kPng)) return sizeOf(b.big(16, 4), b.big(20, 4));
  if (b.has("BM")) return sizeOf(b.little(18, 4), std::min(b.little(22, 4), 0U - b.little(22, 4)));
  if (b.has("II*\0"sv) || b.has("MM\0*"sv)) return tiffSize(b);
  if (b.has("RIFF") && b.has("WEBP", 8)) return webpSize(b);
  if (isPnm(b)) return sizeOf(pnmHeader(b).numbers[0], pnmHeader(b).numbers[1]);
  return std::nullopt;
}

cv::Mat decodeGrey(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  const Bytes b{bytes};
  const bool binary_pnm = b.has("P5") || b.has("P6");
  if (bytes.empty() || (binary_pnm && !isCompletePnm(b)))
    throw IoError(fmt::format("{}: the image is truncated", name));
  const std::optional<cv::Size> size = sizeInHeader(bytes);
  if (size) checkSize(*size, name);
  if (b.has(kPng)) return decodePng(bytes, name);
  cv::Mat image;
  const bool jpeg = b.has(kJpeg);
  if (jpeg) image = decodeJpeg(bytes, name);
  if (image.empty() && (size || jpeg) && isLeftToOpenCv(b)) image = decodeByOpenCv(bytes);
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
