// SPDX-License-Identifier: BSD-3-Clause
#include "io/png.h"

#include "dsorb/error.h"

#include <fmt/format.h>
#include <png.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstring>
#include <stdexcept>

namespace dsorb {
namespace {

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

}  // namespace

bool isPng(const std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t kSignature = 8;
  return bytes.size() >= kSignature && png_sig_cmp(bytes.data(), 0, kSignature) == 0;
}

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
    for (int y = 0; y < height; ++y) rows.push_back(image.ptr(y));
    done = readPngRows(reader, rows.data());
  }
  if (!done) {
    throw IoError(fmt::format(
        "{}: the image is truncated or damaged: {}", name, reader.complaint.text.data()));
  }
  return image;
}

std::string encodePng(const cv::Mat& image) {
  const int type = image.type();
  if (image.empty() || (type != CV_8UC1 && type != CV_16UC1 && type != CV_8UC3)) {
    throw std::invalid_argument(fmt::format(
        "encodePng: expected a grey image of 8 or 16 bits or BGR, got OpenCV's type {}", type));
  }
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.cols);
  png.height = static_cast<png_uint_32>(image.rows);
  png.format = type == CV_16UC1  ? PNG_FORMAT_LINEAR_Y
               : type == CV_8UC3 ? PNG_FORMAT_BGR
                                 : PNG_FORMAT_GRAY;
  png.flags = PNG_IMAGE_FLAG_FAST;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  const auto row = static_cast<png_int_32>(image.step / image.elemSize1());
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, image.data, row, nullptr) == 0) {
    throw std::runtime_error(fmt::format("libpng: {}", static_cast<const char*>(png.message)));
  }
  bytes.resize(size);
  return bytes;
}

}  // namespace dsorb
